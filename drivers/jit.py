"""The one place that loads numba, and decides where its compiled code is kept.

Numba's cache looks only at the file that holds a function: when a helper in another file changes, the old machine
code of its caller would go on being used, silently. So the cache folder carries a hash of **all** files with
kernels (every file named ``*kernels.py`` in this distribution), and a change in any of them starts an empty one.

Import `njit`, `prange` and `cfunc` from here, in files named ``*kernels.py`` only, and import those files lazily: a
command that computes nothing must not pay for numba.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["CACHE_FOLDER", "cfunc", "kernel_files", "kernel_hash", "lean_njit", "njit", "prange"]

_PACKAGES: Final = ("drivers", "sim_backend", "bench")


def kernel_files(root: Path) -> list[Path]:
    """Return all files with kernels below the folder `root` that holds the packages, sorted."""
    return sorted(f for p in _PACKAGES for f in (root / p).rglob("*kernels.py"))


def kernel_hash(root: Path) -> str:
    """Return a hash of the names and contents of all kernel files below `root`."""
    digest = hashlib.sha256()
    for file in kernel_files(root):
        digest.update(file.relative_to(root).as_posix().encode())
        digest.update(b"\0")
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def _base() -> Path:
    """Return the first of the user's choice, the user's cache and a new private folder that is writable."""
    home = os.environ.get("HOME") or os.environ.get("USERPROFILE")
    choices = [
        os.environ.get("EVS_BENCH_CACHE"),
        os.environ.get("XDG_CACHE_HOME"),
        str(Path(home) / ".cache") if home else None,
    ]
    for choice in choices:
        if choice:
            folder = Path(choice) / "evs-bench"
            try:
                folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            except OSError:
                continue
            if os.access(folder, os.W_OK):
                return folder
    # Compiled code is loaded from here, so it must not be a name that somebody else could have made first.
    return Path(tempfile.mkdtemp(prefix="evs-bench-"))


_ROOT: Final = Path(__file__).resolve().parent.parent
CACHE_FOLDER: Final = _base() / "kernels" / kernel_hash(_ROOT)

os.environ["NUMBA_CACHE_DIR"] = str(CACHE_FOLDER)

from numba import cfunc, njit, prange  # noqa: E402
from numba import config as _config  # noqa: E402

_config.CACHE_DIR = str(CACHE_FOLDER)  # type: ignore[attr-defined]


def lean_njit(*, forceinline: bool = False) -> Callable[[Any], Any]:
    """Return the decorator of kernels that make no array, which so need not count references to any.

    The counting is done by locked instructions, of which each costs as much as a square root.
    """
    options: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy", "_nrt": False}
    decorator: Callable[[Any], Any] = njit(forceinline=forceinline, **options)
    return decorator
