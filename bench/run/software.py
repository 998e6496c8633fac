"""Which software took a run: versions, and the revision of a checkout with whether it was modified."""

from __future__ import annotations

import platform
import shutil
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

__all__ = ["revision", "software_versions"]

_PACKAGES: Final = ("numpy", "scipy", "h5py", "numba", "pydantic")
_ROOT: Final = Path(__file__).resolve().parents[2]


def software_versions() -> dict[str, Any]:
    """Return the versions of the bench, of Python and of what computes, and the revision where there is one."""
    versions: dict[str, Any] = {"evs_bench": _version("evs-bench"), "python": platform.python_version()}
    versions |= {name: _version(name) for name in _PACKAGES}
    versions["platform"] = platform.platform()
    return versions | revision(_ROOT)


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "unknown"


def revision(root: Path) -> dict[str, Any]:
    """Return `revision` and `modified` of the git checkout at `root`; nothing where it is none."""
    git = shutil.which("git")
    if git is None or not (root / ".git").exists():
        return {}
    head = _ask([git, "-C", str(root), "rev-parse", "HEAD"])
    changes = _ask([git, "-C", str(root), "status", "--porcelain", "--untracked-files=no"])
    return {} if head is None or changes is None else {"revision": head, "modified": bool(changes)}


def _ask(command: list[str]) -> str | None:
    """Return what `command` prints; None if it fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True)  # noqa: S603
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
