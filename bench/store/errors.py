"""What is wrong with a run folder: one line, with the file and what was expected in it."""

from __future__ import annotations

from protocols.errors import InputError

__all__ = ["RunError"]


class RunError(InputError):
    """A run folder, or a file in it, cannot be read or written as the run format says."""
