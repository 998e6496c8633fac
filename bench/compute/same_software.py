"""Whether another machine runs the same software: only then is what it computes the same."""

from __future__ import annotations

import hashlib
import platform
import socket
from importlib.metadata import version
from pathlib import Path
from typing import Final

from bench.compute.executor import ComputeError

__all__ = ["require_same_software", "software"]

_ROOT: Final = Path(__file__).resolve().parents[2]
_OURS: Final = ("bench", "drivers", "protocols", "sim_backend")
_OTHERS: Final = ("numpy", "scipy", "numba")


def software() -> dict[str, str]:
    """Return the version of Python and of what computes, and a hash of our own code."""
    digest = hashlib.sha256()
    for file in sorted(file for package in _OURS for file in (_ROOT / package).rglob("*.py")):
        digest.update(file.relative_to(_ROOT).as_posix().encode() + b"\0" + file.read_bytes())
    python = ".".join(platform.python_version_tuple()[:2])
    return {
        "python": python,
        **{name: version(name) for name in _OTHERS},
        "code of evs-bench": digest.hexdigest()[:12],
    }


def require_same_software(expected: dict[str, str]) -> None:
    """Raise :class:`ComputeError` unless this machine runs the software `expected`."""
    here = software()
    different = [f"{name} {here[name]}, not {theirs}" for name, theirs in expected.items() if here[name] != theirs]
    if different:
        raise ComputeError(f"worker on {socket.gethostname()} has other software: {'; '.join(different)}")
