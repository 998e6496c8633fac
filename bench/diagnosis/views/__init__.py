"""The statistics in which effects show; each view is one way to look at a recording."""
