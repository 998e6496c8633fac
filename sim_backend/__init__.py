"""The pixel's physics, and instruments made of it."""
