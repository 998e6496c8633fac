"""The run folder: writing, reading, journal."""
