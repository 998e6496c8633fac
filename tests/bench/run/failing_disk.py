"""A disk that takes no more from a moment on: full, read-only, or gone wrong. It fails where a real one does."""

from __future__ import annotations

import builtins
import errno
import io
import os
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench.store import Run
from bench.store.layout import CONTROL_FILE
from protocols import LoadedProtocol, parse_protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import pytest

__all__ = ["FailingDisk", "is_as", "short_protocol"]

_MAKES: Final = ("mkdir", "replace", "rename")
_CHANGES: Final = frozenset("wax+")


class FailingDisk:
    """Lets every call that changes something below a folder fail, from the so-many-th on.

    What a full disk still does (reading, removing, giving another name) a full one of these does, too: it comes to
    itself after `lasts` failures, as where a half-written file was removed.

    Parameters
    ----------
    folder
        What is below it is on this disk.
    number
        Of the errors.
    at
        The call that fails first, from 1; None for no call.
    lasts
        So many calls fail.
    """

    def __init__(self, folder: Path, number: int, at: int | None, lasts: int) -> None:
        self._folder = os.fspath(folder.resolve())
        self.number = number
        self._at = at
        self._lasts = lasts
        self.calls: list[str] = []  #: what was asked of the disk
        self.failed: list[str] = []  #: what it did not do

    def asked(self, what: str, path: Any) -> bool:
        """Take note of a call, and return whether it fails."""
        self.calls.append(f"{what} {path if isinstance(path, int) else os.path.basename(path)}")  # noqa: PTH119
        if self._at is None or not self._at <= len(self.calls) or len(self.failed) >= self._lasts:
            return False
        self.failed.append(self.calls[-1])
        return True

    def is_here(self, path: object) -> bool:
        """Return whether a path, or an open file, is on this disk."""
        if isinstance(path, int):
            path = Path(f"/proc/self/fd/{path}").resolve()
        if not isinstance(path, str | os.PathLike) or CONTROL_FILE in os.fspath(path):
            return False  # another thread looks for a wish all the time
        return os.path.abspath(path).startswith(self._folder)  # noqa: PTH100

    def error(self, path: object = None) -> OSError:
        """Return what the system says."""
        name = os.fspath(path) if isinstance(path, str | os.PathLike) else None
        return OSError(self.number, os.strerror(self.number), name)

    @contextmanager
    def used(self, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
        """Put it in the place of the real one, meanwhile."""
        with monkeypatch.context() as patch:
            patch.setattr(os, "fsync", self._refusing("fsync", os.fsync))
            for name in _MAKES if self.number == errno.ENOSPC else (*_MAKES, "unlink"):
                patch.setattr(os, name, self._refusing(name, getattr(os, name)))
            opening = self._opening(io.open)
            patch.setattr(io, "open", opening)
            patch.setattr(builtins, "open", opening)
            yield

    def _refusing(self, what: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def refusing(path: Any, *arguments: Any, **named: Any) -> Any:
            nothing_to_do = what == "mkdir" and os.path.exists(path)  # noqa: PTH110 - it may be text
            if not nothing_to_do and self.is_here(path) and self.asked(what, path):
                raise self.error(path)
            return function(path, *arguments, **named)

        return refusing

    def _opening(self, real: Callable[..., Any]) -> Callable[..., Any]:
        def opening(file: Any, mode: str = "r", buffering: int = -1, *arguments: Any, **named: Any) -> Any:
            if isinstance(file, int) or not _CHANGES & set(mode) or not self.is_here(file):
                return real(file, mode, buffering, *arguments, **named)
            if self.asked("open", file):
                raise self.error(file)
            raw: Any = _File(self, file, mode.replace("b", "").replace("t", ""))
            if buffering == 0:
                return raw
            buffered: Any = io.BufferedRandom(raw) if "+" in mode else io.BufferedWriter(raw)
            return buffered if "b" in mode else io.TextIOWrapper(buffered, *arguments, **named)

        return opening


class _File(io.FileIO):
    """A file on the disk; a write that fails leaves half of what it was given."""

    def __init__(self, disk: FailingDisk, path: Any, mode: str) -> None:
        super().__init__(path, mode)
        self._disk = disk
        self._path = path

    def write(self, data: Any) -> int:
        if self._disk.asked("write", self._path):
            super().write(memoryview(data).cast("B")[: len(data) // 2])
            raise self._disk.error()
        return super().write(data)

    def truncate(self, size: int | None = None) -> int:
        if self._disk.number != errno.ENOSPC and self._disk.asked("truncate", self._path):
            raise self._disk.error()
        return super().truncate(size)


_TEXT: Final = """\
format: evs-bench-protocol/1
title: a short one
seed: 8
roi: {x: 10, y: 20, width: 3, height: 2}
expect: {dark_light_lux: 0.146}
settings: {thresholds: {on: 0.3, off: 0.25}, refractory_period_s: 0.01, bandwidth_hz: 200}
suspend: {disk_free_mib: null}
pulses: 2
measurements:
  - name: "square"
    stimulus: {kind: square, frequency_hz: 10}
    sweep: {illuminance_lux: [10], contrast: {scale: log, values: [0.5, 0.9]}}
"""


def short_protocol() -> LoadedProtocol:
    """Return two points, which never wait for room on the disk."""
    return parse_protocol(_TEXT, "short.yaml")


def is_as(folder: Path, whole: Path) -> None:
    """Assert that a run has come to its end, with the events of another one, and every point once."""
    run = Run.open(folder)
    run.verify()
    assert run.journal[-1].state == "run_finished"
    assert sorted(e.point for e in run.journal if e.state == "done" and e.point is not None) == [0, 1]
    for one, other in zip(run.points(), Run.open(whole).points(), strict=True):
        assert (one.index, one.attributes.get("seed")) == (other.index, other.attributes.get("seed"))
        for chunk, wanted in zip(one.events(), other.events(), strict=True):
            np.testing.assert_array_equal(chunk, wanted)
