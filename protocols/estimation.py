"""How long a protocol takes, and how large its run becomes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from protocols.points import ConstantTiming, Point, SquareTiming
from protocols.preamble import preamble_s

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["Estimate", "estimate", "recording_s"]

BYTES_PER_EVENT = 13  #: t int64, x and y uint16, p uint8, before compression
BYTES_PER_FILE = 20_000  #: an HDF5 file without its events
BYTES_PER_PULSE = 50  #: edges and windows of one pulse
BACKGROUND_PER_PIXEL_HZ = 0.1  #: assumed background activity, both polarities together


@dataclass(frozen=True, slots=True)
class Estimate:
    """Time and size of a run.

    What an operator takes for a step, the start of the devices and the time to write files are not known beforehand
    and are not in it.
    """

    duration_s: float  #: measuring and settling, s
    measuring_s: float  #: sum of all recordings, s
    settling_s: float  #: waiting for light, filters and biases, s
    bytes: int  #: size of the run folder, before compression
    nd_changes: int  #: moves of the filter wheel after the first point
    points: int  #: number of points
    operator_steps: int  #: how often a person has to do something
    added: int = 0  #: of the points, those that are added to curves at most: time and size are the worst case


def estimate(points: Sequence[Point], added: int = 0) -> Estimate:
    """Return time and size of a run that takes `points` in this order; `added` of them may not be needed.

    Time: for each point the recording, and `settle.light_s`; `settle.filter_s` more where the ND filter differs from
    that of the point before, and `settle.bias_s` more where settings or window do. For the first point filter, biases
    and window have to be set, so that it waits for all.

    Size: for each point 13 bytes for each event, 50 for each pulse and 20 kB for the file. Each pixel is taken to
    give one event for each edge of the light, and 0.1 background events per second. Files are compressed, so that
    this is an upper bound for a quiet sensor; a noisy one gives more.
    """
    measuring_s = math.fsum(recording_s(point) for point in points)
    settling_s = _settling_s(points)
    return Estimate(
        duration_s=measuring_s + settling_s,
        measuring_s=measuring_s,
        settling_s=settling_s,
        bytes=sum(_bytes(point) for point in points),
        nd_changes=sum(a.nd_od != b.nd_od for a, b in pairwise(points)),
        points=len(points),
        operator_steps=sum(point.operator_before is not None for point in points),
        added=added,
    )


def _settling_s(points: Sequence[Point]) -> float:
    waits = [point.settle.light_s for point in points]
    for i, point in enumerate(points):
        before = points[i - 1] if i else None
        if before is None or before.nd_od != point.nd_od:
            waits.append(point.settle.filter_s)
        if before is None or (before.settings, before.roi) != (point.settings, point.roi):
            waits.append(point.settle.bias_s)
    return math.fsum(waits)


def recording_s(point: Point) -> float:
    """Return the length of the recording of `point`, s; the same as that of its stimulus."""
    timing = point.timing
    before_s = 0.0 if point.preamble is None else preamble_s(point.preamble)
    if isinstance(timing, ConstantTiming):
        return timing.duration_s
    if isinstance(timing, SquareTiming):
        return before_s + (point.pulses + 1.0 - timing.duty) / timing.frequency_hz
    period_s = 2 * timing.gap_s + timing.reset_s + timing.test_s
    return before_s + point.pulses * period_s + timing.gap_s


def _bytes(point: Point) -> int:
    edges = point.pulses * (2 if point.waveform == "square" else 4)
    events_per_pixel = edges + BACKGROUND_PER_PIXEL_HZ * recording_s(point)
    events = round(events_per_pixel * point.roi.pixels)
    return BYTES_PER_EVENT * events + BYTES_PER_PULSE * point.pulses + BYTES_PER_FILE
