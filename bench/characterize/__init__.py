"""From a family of S-curves to the numbers of a sensor: threshold, dark light, noise, bandwidth, mismatch."""
