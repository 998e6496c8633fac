"""What one finished point says: its responses or its background rates, counted as the analysis counts them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from bench.analysis.grouping import Entry
    from bench.analysis.results import BackgroundRow, ResponsePolarity
    from bench.analysis.tally import GroupTally, PointTally
    from bench.store.data import PointData
    from bench.watch.history import DoneFile
    from protocols.points import Roi

__all__ = ["PointCounts", "Response", "count_point"]


@dataclass(frozen=True, slots=True)
class Response:
    """The answers to the test pulses of one polarity and contrast of a point."""

    polarity: ResponsePolarity
    log_contrast: float
    pulses: int
    pixels: int
    probability: float
    low: float
    high: float
    entry: Entry  #: what sorts it into a curve; without the counts, so that thousands fit into memory


@dataclass(frozen=True, slots=True)
class PointCounts:
    """What is kept of a point."""

    index: int
    bias: dict[str, float]
    responses: tuple[Response, ...]
    background: tuple[BackgroundRow, ...]  #: without the label of the settings, which only the whole run tells
    remarks: tuple[str, ...]  #: what is wrong with its data, for people


def count_point(folder: Path, done: DoneFile, roi: Roi) -> PointCounts:
    """Read the file of a finished point, and count.

    Parameters
    ----------
    folder
        The run folder.
    done
        What the journal says of the file.
    roi
        The run's window.

    Raises
    ------
    RunError
        In one line: the file is not there, was changed, is damaged, or lies outside the folder.
    """
    from bench.analysis.background import background_rows
    from bench.analysis.tally import tally_point
    from bench.store.reader import read_point

    point = read_point(_sound(folder, done), roi)
    tally = tally_point(point)
    constant = point.waveform == "constant"
    return PointCounts(
        index=done.point,
        bias=point.bias,
        responses=tuple(_response(point, tally, group) for group in tally.groups),
        background=background_rows(point, tally, "") if constant else (),
        remarks=tuple(_remarks(point, tally)),
    )


def _sound(folder: Path, done: DoneFile) -> Path:
    """Return the file of a point if it is as it was written, or can be read without harm to this process."""
    from bench.store.errors import RunError
    from bench.store.probe import probe
    from bench.store.run import sha256_of

    if done.file is None:
        raise RunError("the journal names no file")
    path = folder / done.file
    if not path.resolve().is_relative_to(folder.resolve()):
        raise RunError(f"{done.file} lies outside the run folder")
    if not path.is_file():
        raise RunError(f"{done.file} is not there")
    if done.sha256 is None:
        probe([path])
    elif sha256_of(path) != done.sha256:
        raise RunError(f"{done.file} was changed since it was written")
    return path


def _response(point: PointData, tally: PointTally, group: GroupTally) -> Response:
    from bench.analysis.grouping import Entry, curve_keys
    from bench.analysis.responses import response_row

    entry = Entry.of(point, tally.active, group)
    row = response_row(entry, curve_keys([entry], [""])[0])
    return Response(
        polarity=row.key.polarity,
        log_contrast=row.log_contrast,
        pulses=row.pulses,
        pixels=row.pixels,
        probability=row.probability,
        low=row.low,
        high=row.high,
        entry=replace(entry, active=entry.active[:0], tally=_without_counts(group)),
    )


def _without_counts(group: GroupTally) -> GroupTally:
    return replace(
        group,
        answers=group.answers[:0].copy(),
        given=group.given[:0].copy(),
        followed=group.followed[:0].copy(),
        latencies=group.latencies[:0].copy(),
        rearmed=group.rearmed[:0].copy(),
    )


def _remarks(point: PointData, tally: PointTally) -> Iterator[str]:
    from bench.analysis.curves import REARMED_ENOUGH
    from bench.report.wording import count

    if len(point.gaps_s):
        yield f"{count(len(point.gaps_s), 'stretch', 'stretches')} without data"
    if tally.left_out:
        yield f"{count(tally.left_out, 'test pulse')} not counted"
    if point.waveform != "constant" and not tally.groups:
        yield "no test pulse can be used"
    if not tally.active.any():
        yield "all pixels are masked"
    answered = min((_answered(tally, group) for group in tally.groups if group.resets), default=math.nan)
    if answered < REARMED_ENOUGH:
        yield f"only {answered:.0%} of the resets were answered"


def _answered(tally: PointTally, group: GroupTally) -> float:
    asked = group.resets * int(tally.active.sum())
    return float(group.rearmed[tally.active].sum()) / asked if asked else math.nan
