"""The views that there are: the built-in ones, and those of files that were named."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bench.diagnosis.views.array import Burst, Neighbours, Outliers
from bench.diagnosis.views.background import (
    Background,
    BackgroundHalves,
    BackgroundSpread,
    Intervals,
    Regularity,
    SamePolarity,
)
from bench.diagnosis.views.latency import Latency, LatencySpread, SecondEvent
from bench.diagnosis.views.locked import Locked, LockedAcross
from bench.diagnosis.views.response import ExtraEvents, OtherPolarity, Response
from bench.diagnosis.views.scatter import CommonMode, Halves, PixelSpread, Succession
from bench.diagnosis.views.user_file import read_view_file
from protocols.errors import InputError
from protocols.user_module import sha256_of

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterable, Sequence

    from bench.diagnosis.views.base import View
    from bench.diagnosis.views.user_file import ViewSource

__all__ = ["VIEWS", "forget_view_files", "load_same_view_files", "load_view_files", "same_views", "views"]

VIEWS: Final[tuple[View, ...]] = (
    Response(),
    ExtraEvents(),
    OtherPolarity(),
    Latency(),
    LatencySpread(),
    SecondEvent(),
    PixelSpread(),
    Succession(),
    Halves(),
    CommonMode(),
    Background(),
    BackgroundHalves(),
    BackgroundSpread(),
    SamePolarity(),
    Intervals(),
    Regularity(),
    Neighbours(),
    Outliers(),
    Burst(),
    Locked(),
    LockedAcross(),
)

_FILES: Final[dict[Path, ViewSource]] = {}


def views() -> tuple[View, ...]:
    """Return all views: the built-in ones, then those of a user's files."""
    return (*VIEWS, *(view for source in _FILES.values() for view in source.views))


def load_view_files(paths: Iterable[str | os.PathLike[str]]) -> None:
    """Look with the views of a user's own files, too. A file that is loaded already is left alone.

    Raises
    ------
    InputError
        A file cannot be used, or an id is taken; one line.
    """
    for path in paths:
        where = Path(path).resolve()
        if where in _FILES and where.is_file() and sha256_of(where) == _FILES[where].sha256:
            continue
        found = read_view_file(path)
        taken = {view.id: "a built-in view" for view in VIEWS}
        taken |= {v.id: str(known) for known, source in _FILES.items() if known != where for v in source.views}
        for view in found.views:
            if view.id in taken:
                raise InputError(f"{path}: the id {view.id} is taken ({taken[view.id]}); choose another")
            taken[view.id] = "the same file"
        _FILES[where] = found


def forget_view_files() -> None:
    """Look with the built-in views alone again."""
    _FILES.clear()


def load_same_view_files(files: Sequence[tuple[str, str]]) -> None:
    """Load files in another process: each path with the SHA-256 that it had here.

    Raises
    ------
    InputError
        A file cannot be used, or is another than it was.
    """
    for path, sha256 in files:
        load_view_files([path])
        if _FILES[Path(path)].sha256 != sha256:
            raise InputError(f"{path}: is another file for this worker than when it was named; expected the same")


def same_views() -> Callable[[], object] | None:
    """Return what another process does first: it loads the user's own views; None where there are none."""
    files = [(source.path, source.sha256) for source in _FILES.values()]
    return partial(load_same_view_files, files) if files else None
