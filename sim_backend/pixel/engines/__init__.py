"""Engines: chain + stimulus + seed -> events."""
