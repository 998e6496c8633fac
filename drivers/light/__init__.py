"""Drivers of light sources."""
