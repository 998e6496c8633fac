"""The events of one point file, in chunks, checked as they are read."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.store import layout
from bench.store.datasets import Datasets, opened
from bench.store.errors import RunError
from drivers.events.types import EVENT_DTYPE

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import numpy.typing as npt

    from protocols.points import Roi

__all__ = ["read_events"]


def read_events(
    path: Path, chunk: int = 1_000_000, roi: Roi | None = None, until_s: float = math.inf
) -> Iterator[npt.NDArray[np.void]]:  # fmt: skip
    """Yield the events of the point file `path` in order, at most `chunk` at a time.

    Parameters
    ----------
    path
        An HDF5 file of format ``evs-bench-point/1``.
    chunk
        Largest number of events in one array.
    roi
        The window in which all events must lie; None for no such check.
    until_s
        Later events are neither read nor checked.

    Yields
    ------
    ndarray
        (n,) of :data:`~drivers.events.types.EVENT_DTYPE`, n > 0.

    Raises
    ------
    RunError
        If the file is damaged, time goes back, or an event lies outside the window.
    """
    with opened(path) as file:
        datasets = Datasets(path, file)
        n = datasets.event_count()
        columns = {spec.path[-1]: datasets.dataset(spec) for spec in layout.EVENT_DATASETS}
    done, last_t = 0, 0
    while done < n:
        with opened(path) as file:
            columns = {spec.path[-1]: file[spec.path] for spec in layout.EVENT_DATASETS}
            events = _slice(columns, done, min(n, done + chunk))
        _check_events(path, events, done, last_t, roi)
        last_t = int(events["t"][-1])
        done += len(events)
        if last_t <= until_s * 1e6:
            yield events
            continue
        wanted = events[events["t"] <= until_s * 1e6]
        if len(wanted):
            yield wanted
        return


def _slice(columns: dict[str, Any], start: int, stop: int) -> npt.NDArray[np.void]:
    events = np.empty(stop - start, EVENT_DTYPE)
    for name, column in columns.items():
        events[name] = column[start:stop]
    return events


def _check_events(path: Path, events: npt.NDArray[np.void], first: int, last_t: int, roi: Roi | None) -> None:
    """Raise unless time does not go back, polarity is 0 or 1, and all lie in the window."""
    t = events["t"]
    falls = np.flatnonzero(np.diff(t, prepend=last_t) < 0)
    if falls.size:
        raise RunError(
            f"{path}: the dataset /events/t goes back in time (or before 0) at event {first + int(falls[0])}"
        )
    wrong = np.flatnonzero(events["p"] > 1)
    if wrong.size:
        raise RunError(f"{path}: the dataset /events/p holds {int(events['p'][wrong[0]])}, expected 0 or 1")
    if roi is None:
        return
    x, y = events["x"].astype(np.int64) - roi.x, events["y"].astype(np.int64) - roi.y
    outside = np.flatnonzero((x < 0) | (y < 0) | (x >= roi.width) | (y >= roi.height))
    if outside.size:
        e = events[outside[0]]
        raise RunError(
            f"{path}: event {first + int(outside[0])} at x = {e['x']}, y = {e['y']} lies outside the window "
            f"({roi.width} x {roi.height} from {roi.x}, {roi.y})"
        )
