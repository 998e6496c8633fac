"""The version of this software, and the revision it was run from."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as _distribution_version

__all__ = ["version"]


def version() -> str:
    """Return the version of the installed distribution, or ``0+unknown`` in a bare source tree."""
    try:
        return _distribution_version("evs-bench")
    except PackageNotFoundError:
        return "0+unknown"
