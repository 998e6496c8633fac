"""The analysis of a whole run: points one after the other, then the curves."""

from __future__ import annotations

from collections.abc import Sized
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from bench.analysis.background import background_rows, drift_warnings
from bench.analysis.compact import compact
from bench.analysis.curves import REARMED_ENOUGH, make_curves
from bench.analysis.grouping import Entry, curve_keys, settings_labels
from bench.analysis.responses import response_row
from bench.analysis.results import Analysis
from bench.analysis.tally import tally_point

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import numpy.typing as npt

    from bench.analysis.curves import ThetaFitter
    from bench.analysis.results import BackgroundRow, ResponseRow, SCurve
    from bench.analysis.tally import PointTally
    from bench.store.data import PointData, RunHeader
    from protocols.points import Roi

__all__ = ["RunLike", "analyze"]


class RunLike(Protocol):
    """What the analysis needs of a run: :class:`bench.store.Run` has it."""

    @property
    def header(self) -> RunHeader:
        """What ``run.yaml`` says."""
        ...

    def points(self) -> Iterator[PointData]:
        """Yield the points that were recorded."""
        ...


class _Collected:
    """What is kept of the points: counts, never events."""

    def __init__(self) -> None:
        self.entries: list[Entry] = []
        self.constant: list[tuple[dict[str, float], tuple[BackgroundRow, ...]]] = []
        self._active: npt.NDArray[np.bool_] = np.empty(0, np.bool_)
        self.maps: dict[Roi, npt.NDArray[np.int64]] = {}
        self.warnings: list[str] = []
        self.untimed = 0  #: points whose time axis the events told
        self.doubtful: list[tuple[int, str]] = []  #: points whose time axis may be wrong, and why

    def add(self, point: PointData, tally: PointTally) -> None:
        """Take the counts of one point in."""
        active = self._shared(tally.active)
        for group in tally.groups:
            own = compact(group, square=point.waveform == "square")
            self.entries.append(Entry.of(point, active, own))
        if point.waveform == "constant":
            self.constant.append((point.bias, background_rows(point, tally, "")))
            self.warnings.extend(f"point {point.index}: {text}" for text in drift_warnings(point, tally))
        elif not tally.groups:
            self.warnings.append(f"point {point.index}: no test pulse can be used")
        self.untimed += not point.tells_latency
        if point.quality.get("time_doubtful"):
            self.doubtful.append((point.index, str(point.quality.get("time_note", ""))))
        self.maps.setdefault(point.roi, np.zeros(point.roi.pixels, np.int64))
        self.maps[point.roi] += tally.pixel_events.sum(axis=0)
        self.warnings.extend(f"point {point.index}: {text}" for text in _point_warnings(tally))

    def _shared(self, active: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        """Return the array of the point before where it says the same: most points have the same pixels."""
        if not np.array_equal(active, self._active):
            self._active = active
        return self._active


def _point_warnings(tally: PointTally) -> Iterator[str]:
    if tally.outside:
        yield f"{tally.outside} events lie outside the window of pixels and are not counted"
    if tally.late:
        yield f"{tally.late} events lie after the end of the recording and are not counted"
    if tally.left_out:
        yield f"{tally.left_out} test pulses are not counted: marked as not valid, in a gap of the data, or cut off"
    if tally.overlapping:
        yield "response windows of one polarity overlap; an event counts for the later one"
    if not tally.active.any():
        yield "all pixels are masked"


def analyze(
    run: RunLike,
    *,
    pixel_maps: bool = True,
    progress: Callable[[int, int], None] | None = None,
    theta_fit: ThetaFitter | None = None,
    chunk: int = 1_000_000,
) -> Analysis:
    """Turn a run into a response table, S-curves, background rates and maps.

    Events are read in chunks and only counted, so the run may be larger than memory.

    Parameters
    ----------
    run
        An opened run.
    pixel_maps
        Whether to find each pixel's own 50 % point too.
    progress
        Called with how much is done and of how much, in points while they are read (0 where their number is not
        known beforehand), then in curves.
    theta_fit
        Reads the threshold of a noisy pixel off the rows of one curve, or returns None; default is
        :func:`bench.analysis.noisy_pixel.fit_theta`.
    chunk
        Events that are held in memory at a time.

    Raises
    ------
    bench.store.errors.RunError
        If a file of the run is damaged.
    """
    tell = progress if progress is not None else _silent
    collected = _Collected()
    total = len(run) if isinstance(run, Sized) else 0
    for done, point in enumerate(run.points()):
        tell(done, total)
        collected.add(point, tally_point(point, chunk))
    labels = settings_labels([e.bias for e in collected.entries] + [bias for bias, _ in collected.constant])
    keys = curve_keys(collected.entries, labels[: len(collected.entries)])
    rows = tuple(response_row(e, key) for e, key in zip(collected.entries, keys, strict=True))
    curves, maps = make_curves(
        collected.entries, rows, theta_fit or _noisy_pixel(), pixel_maps=pixel_maps, progress=tell
    )
    event_map, origin = _event_map(collected.maps, run.header.roi)
    return Analysis(
        run_id=run.header.id,
        title=run.header.title,
        responses=rows,
        curves=curves,
        background=_background(collected.constant, labels[len(collected.entries) :]),
        pixel_maps=maps,
        event_map=event_map,
        event_map_origin=origin,
        warnings=(*collected.warnings, *_time_warnings(collected), *_run_warnings(rows, curves)),
    )


def _silent(done: int, total: int) -> None:
    del done, total


def _noisy_pixel() -> ThetaFitter:
    from bench.analysis.noisy_pixel import fit_theta

    return fit_theta


def _background(
    constant: Sequence[tuple[dict[str, float], tuple[BackgroundRow, ...]]], labels: Sequence[str]
) -> tuple[BackgroundRow, ...]:
    """Return the background rows with the labels of their settings, which only the whole run tells."""
    return tuple(
        replace(row, settings=label) for (_, rows), label in zip(constant, labels, strict=True) for row in rows
    )


def _event_map(maps: dict[Roi, npt.NDArray[np.int64]], window: Roi) -> tuple[npt.NDArray[np.int64], tuple[int, int]]:
    """Return the events of all points by pixel, over the smallest window that holds those of all points."""
    rois = list(maps) or [window]
    x, y = min(r.x for r in rois), min(r.y for r in rois)
    right, bottom = max(r.x + r.width for r in rois), max(r.y + r.height for r in rois)
    total = np.zeros((bottom - y, right - x), np.int64)
    for roi, counts in maps.items():
        rows, columns = slice(roi.y - y, roi.y - y + roi.height), slice(roi.x - x, roi.x - x + roi.width)
        total[rows, columns] += counts.reshape(roi.height, roi.width)
    return total, (x, y)


def _time_warnings(collected: _Collected) -> Iterator[str]:
    if collected.untimed:
        yield (
            f"{_points(collected.untimed)} had no triggers: the answers themselves told when the light changed, so "
            "there are no latencies, and nothing that needs them"
        )
    if collected.doubtful:
        first, note = collected.doubtful[0]
        yield (
            f"when the light changed is doubtful in {_points(len(collected.doubtful))}; point {first}: {note}; a "
            "trigger cable or a preamble would tell"
        )


def _points(number: int) -> str:
    return "1 point" if number == 1 else f"{number} points"


def _run_warnings(rows: Sequence[ResponseRow], curves: Sequence[SCurve]) -> Iterator[str]:
    """Yield what concerns the run as a whole: where its curves must not be taken at face value."""
    bad = sorted({row.point for row in rows if row.answered_resets < REARMED_ENOUGH})
    if bad:
        yield (
            f"in {len(bad)} points fewer than {REARMED_ENOUGH:.0%} of the resets were answered; "
            "a larger reset, or a lower threshold of the other polarity, re-arms more pixels"
        )
    open_ended = [c for c in curves if not np.isfinite(c.intercept.value)]
    if open_ended:
        yield f"{len(open_ended)} of {len(curves)} S-curves have no intercept; the note of each says why"
    if any(c.limited_by is not None for c in curves):
        yield "a square wave shows only the less sensitive of the two thresholds; curves of the other are marked"
