"""Models of the pixel, fitted to a run."""
