"""Finding out in a process of its own whether a point file can be read at all.

The HDF5 library does not survive every damaged file: on some it crashes, on some it never comes back. A file whose
checksum stands in the journal is as it was written, and needs no probe; another one is first read to its end by a
child process, which may crash as it likes.
"""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bench.store.errors import RunError
from bench.store.event_reader import read_events
from bench.store.reader import read_point
from protocols.points import Roi

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

__all__ = ["child", "is_known", "probe", "remember"]

_log = logging.getLogger("evs_bench.store")
_SLOWEST_BYTES_PER_S: Final = 2e6
_START_S: Final = 30.0  #: a child process may need so long to begin, on a busy machine
_WHOLE_SENSOR: Final = Roi(0, 0, 65535, 65535)

#: Files that were found readable, as they were then: path, size and time of change.
_known: set[tuple[str, int, int]] = set()


def probe(paths: Iterable[Path]) -> None:
    """Return if `paths` can be read without harm; a file that is only wrong is left to the reader to complain of.

    Raises
    ------
    RunError
        For the first file on which the HDF5 library crashes or never ends.
    """
    unknown = [path for path in paths if path.is_file() and _state(path) not in _known]
    if not unknown:
        return
    survived, how = _read_in_child(unknown)
    remember(unknown[:survived])
    if survived < len(unknown):
        raise RunError(f"{unknown[survived]}: damaged: the HDF5 library {how} on it")


def remember(paths: Iterable[Path]) -> None:
    """Take `paths` for readable as long as they are not changed."""
    _known.update(_state(path) for path in paths)


def is_known(path: Path) -> bool:
    """Return whether `path` was found readable, and was not changed since."""
    return _state(path) in _known


def _state(path: Path) -> tuple[str, int, int]:
    status = path.stat()
    return str(path.resolve()), status.st_size, status.st_mtime_ns


def _read_in_child(paths: Sequence[Path]) -> tuple[int, str]:
    """Return how many of `paths`, in order, a child process could read, and what happened then."""
    limit_s = _START_S + sum(path.stat().st_size for path in paths) / _SLOWEST_BYTES_PER_S
    # Never from the folder in which the command was started: a file there may have the name of one of our packages.
    own = str(Path(__file__).resolve().parents[2])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([*filter(None, sys.path), own])}
    command = [sys.executable, "-P", "-c", "from bench.store.probe import child; child()"]
    names = json.dumps([str(path.resolve()) for path in paths]).encode()
    try:
        done = subprocess.run(  # noqa: S603 - our own interpreter and our own code
            command, input=names, env=environment, capture_output=True, timeout=limit_s, check=False
        )
    except subprocess.TimeoutExpired as error:
        return (error.stdout or b"").count(b"\n"), "does not come to an end"
    if done.returncode > 0:
        raise RuntimeError(f"the probe of point files failed: {done.stderr.decode(errors='replace')}")
    return done.stdout.count(b"\n"), "crashes"


def child() -> None:
    """Read the files named on stdin (a JSON list) to their end, and write a line for each that was survived."""
    for name in json.load(sys.stdin):
        try:
            point = read_point(Path(name), _WHOLE_SENSOR)
            for _ in read_events(Path(name), roi=point.roi):
                pass
        except RunError as error:
            _log.debug("%s", error)
        sys.stdout.write("read\n")
        sys.stdout.flush()
