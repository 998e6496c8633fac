"""Light on the chip and what a pixel makes of it: lux, photons, electrons, femtoampere."""
