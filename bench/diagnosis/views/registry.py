"""The views that there are: the built-in ones, those of installed plug-ins, and those of files that were named."""

from __future__ import annotations

import inspect
from functools import cache, partial
from importlib.metadata import entry_points
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
from bench.diagnosis.views.base import View
from bench.diagnosis.views.latency import (
    EarlyLatency,
    LateLatency,
    Latency,
    LatencySpread,
    MedianLatency,
    SecondEvent,
)
from bench.diagnosis.views.locked import Locked, LockedAcross
from bench.diagnosis.views.response import ExtraEvents, OtherPolarity, Response
from bench.diagnosis.views.scatter import CommonMode, Halves, PixelSpread, Succession
from bench.diagnosis.views.user_file import ViewSource, own_view, read_view_file
from protocols.errors import InputError
from protocols.user_module import sha256_of

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from importlib.metadata import EntryPoint

__all__ = [
    "GROUP",
    "SHOWN",
    "VIEWS",
    "all_views",
    "forget_view_files",
    "load_same_view_files",
    "load_view_files",
    "same_views",
    "shown_views",
    "views",
]

#: Entry-point group of views that other distributions bring.
GROUP: Final = "evs_bench.views"

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
#: Those by which no fit goes.
SHOWN: Final[tuple[View, ...]] = (EarlyLatency(), MedianLatency(), LateLatency())

_BUILT_IN: Final = {view.id: "a built-in view" for view in (*VIEWS, *SHOWN)}
_FILES: Final[dict[Path, ViewSource]] = {}


def views() -> tuple[View, ...]:
    """Return the views by which fits go: the built-in ones, those of plug-ins, then those of a user's files.

    Raises
    ------
    InputError
        A plug-in cannot be imported, brings something that is no view, or an id that is taken.
    """
    return (*VIEWS, *(view for view in _of_others() if view.fitted))


def shown_views() -> tuple[View, ...]:
    """Return the views by which no fit goes, which `compare` shows beside the others; in the same order.

    Raises
    ------
    InputError
        As for :func:`views`.
    """
    return (*SHOWN, *(view for view in _of_others() if not view.fitted))


def all_views() -> tuple[View, ...]:
    """Return the views by which fits go, and then those that are shown alone.

    Raises
    ------
    InputError
        As for :func:`views`.
    """
    return (*views(), *shown_views())


def _of_others() -> Iterator[View]:
    for source in (*_plug_ins(), *_FILES.values()):
        yield from source.views


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
        others = dict(_BUILT_IN)
        others |= {view.id: f"of {source.package}" for source in _plug_ins() for view in source.views}
        others |= {v.id: str(known) for known, source in _FILES.items() if known != where for v in source.views}
        _refuse_taken(f"{path}", found.views, others)
        _FILES[where] = found


def _refuse_taken(owner: str, found: Iterable[View], others: Mapping[str, str]) -> None:
    taken = dict(others)
    for view in found:
        if view.id in taken:
            raise InputError(f"{owner}: the id {view.id} is taken ({taken[view.id]}); choose another")
        taken[view.id] = "the same file"


@cache
def _plug_ins() -> tuple[ViewSource, ...]:
    """Return the views of installed plug-ins. Each process finds them by itself."""
    taken = dict(_BUILT_IN)
    found = []
    for point in entry_points(group=GROUP):
        source = _plug_in(point)
        _refuse_taken(f"plug-in {point.name} ({point.value})", source.views, taken)
        taken |= {view.id: f"of {source.package}" for view in source.views}
        found.append(source)
    return tuple(found)


def _plug_in(point: EntryPoint) -> ViewSource:
    owner = f"plug-in {point.name} ({point.value})"
    try:
        cls = point.load()
    except (ImportError, AttributeError) as error:
        raise InputError(f"{owner}: cannot be imported: {error}") from error
    if not (isinstance(cls, type) and issubclass(cls, View)):
        raise InputError(f"{owner}: expected a class derived from View")
    file = inspect.getsourcefile(cls)
    view = own_view(cls, owner, file or owner)
    package = f"{point.dist.name} {point.dist.version}" if point.dist else point.value.partition(":")[0]
    return ViewSource(file or "", sha256_of(Path(file)) if file else "", (view,), package)


def forget_view_files() -> None:
    """Look without the views of files again."""
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
