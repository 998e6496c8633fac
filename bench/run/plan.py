"""What a station must do for each point: filter, drive levels, biases; and what of it it cannot."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np

from drivers.errors import DeviceError
from drivers.interfaces import Limits, Waveform
from protocols import stimulus_of
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from bench.station import Station
    from protocols.points import Point
    from protocols.stimulus import Stimulus

_T = TypeVar("_T")
_SAME_TIME_S: Final = 1e-7

__all__ = ["PlannedPoint", "Refusal", "plan", "plan_or_raise", "ranges_text"]


@dataclass(frozen=True, slots=True)
class PlannedPoint:
    """A point in the terms of the station's devices."""

    point: Point
    stimulus: Stimulus
    filter_name: str
    waveform: Waveform  #: levels in the unit of the light source, as it can be set to them
    biases: dict[str, int]  #: offsets from the factory codes
    log_contrast: float  #: of the steps that the source can be set to, ln


@dataclass(frozen=True, slots=True)
class Refusal:
    """One thing that the station cannot do, and the points that ask for it."""

    measurement: str
    points: tuple[int, ...]
    message: str


def plan(points: Sequence[Point], station: Station) -> tuple[list[PlannedPoint], list[Refusal]]:
    """Return what the station must do for `points`, and all that it cannot, without connecting to it.

    Returns
    -------
    planned
        The points that can be taken, in order.
    refusals
        One for each measurement and thing that cannot be done.
    """
    planned: list[PlannedPoint] = []
    refused: dict[tuple[str, str], tuple[list[int], list[float]]] = {}
    for point in points:
        problems: list[_Problem] = []
        result = _plan_point(point, station, problems)
        for problem in problems:
            at, lux = refused.setdefault((point.measurement, problem.message), ([], []))
            at.append(point.index)
            lux += problem.lux
        if result is not None:
            planned.append(result)
    return planned, [
        Refusal(name, tuple(at), f"{_lux_text(lux)}{message}") for (name, message), (at, lux) in refused.items()
    ]


@dataclass(frozen=True, slots=True)
class _Problem:
    """Why a point cannot be taken; the levels stand apart, so that the same reason of many points is one."""

    message: str
    lux: tuple[float, ...] = ()


def _lux_text(lux: Sequence[float]) -> str:
    if not lux:
        return ""
    lowest, highest = min(lux), max(lux)
    return f"{lowest:.4g} lux" if lowest == highest else f"{lowest:.4g} to {highest:.4g} lux"


def plan_or_raise(points: Sequence[Point], station: Station) -> list[PlannedPoint]:
    """Return what the station must do for `points`.

    Raises
    ------
    InputError
        If a point cannot be taken: one line for each thing that the station cannot do.
    """
    planned, refusals = plan(points, station)
    if refusals:
        raise InputError(*[f"{r.measurement}: {ranges_text(r.points)}: {r.message}" for r in refusals])
    return planned


def _plan_point(point: Point, station: Station, problems: list[_Problem]) -> PlannedPoint | None:
    """Return the plan of one point; None, and the reasons in `problems`, if it cannot be taken."""
    stimulus = stimulus_of(point)
    _collect(problems, lambda: _check_window(point, station))
    biases = _collect(problems, lambda: _biases(point, station))
    filter_name = _collect(problems, lambda: station.calibration.filter_for(point.nd_od))
    if filter_name is None:
        return None
    levels = _levels(stimulus.lux, filter_name, station, problems)
    if problems or biases is None:
        return None
    waveform = Waveform(stimulus.t_s, levels, stimulus.duration_s)
    reason = station.light.why_not(waveform)
    if reason:
        problems.append(_Problem(f"{station.light.name} cannot time it: {reason}"))
        return None
    if station.light.level_step == 0.0:
        return PlannedPoint(point, stimulus, filter_name, waveform, biases, point.log_contrast)
    as_set = replace(stimulus, lux=levels * station.calibration.lux_per_level(filter_name))
    return PlannedPoint(point, as_set, filter_name, waveform, biases, _contrast_of(as_set, point))


def _contrast_of(stimulus: Stimulus, point: Point) -> float:
    """Return the log contrast of the steps at which the windows begin; infinite from or into darkness."""
    if not stimulus.pulse_start_s.size or point.log_contrast == 0.0:
        return point.log_contrast
    edge = np.searchsorted(stimulus.t_s, stimulus.pulse_start_s + _SAME_TIME_S, side="right") - 1
    edge = edge[edge > 0]
    before, after = stimulus.lux[edge - 1], stimulus.lux[edge]
    if not (before.all() and after.all()):  # a level below half a step is set to 0
        return math.inf
    return float(np.median(np.abs(np.log(after / before))))


def _collect(problems: list[_Problem], ask: Callable[[], _T]) -> _T | None:
    """Return what `ask` gives; None, with the reason in `problems`, if it cannot be had."""
    try:
        return ask()
    except (InputError, DeviceError) as error:
        problems.append(_Problem(" ".join(str(error).split())))
        return None


def _check_window(point: Point, station: Station) -> None:
    roi, name = point.roi, station.camera.name
    for axis, first, size, end in (
        ("x", roi.x, roi.width, station.camera.width),
        ("y", roi.y, roi.height, station.camera.height),
    ):
        Limits(0, end - 1, "pixel").require(name, f"window {axis}", first)
        Limits(1, end - first, "pixel").require(name, f"window size in {axis}", size)


def _biases(point: Point, station: Station) -> dict[str, int]:
    biases = station.calibration.biases_for(point.settings)
    for name, offset in biases.items():
        if name not in station.camera.bias_limits:
            raise InputError(f"{station.camera.name} has no {name}; it has {', '.join(station.camera.bias_limits)}")
        station.camera.bias_limits[name].require(station.camera.name, name, offset)
    return biases


def _levels(
    lux: npt.NDArray[np.float64], filter_name: str, station: Station, problems: list[_Problem]
) -> npt.NDArray[np.float64]:
    """Return the drive level for each entry of `lux`; those that the source cannot reach go into `problems`."""
    calibration = station.calibration
    different, where = np.unique(lux, return_inverse=True)
    beyond = tuple(float(value) for value in different if not calibration.reachable(float(value), filter_name))
    if beyond:
        reach = calibration.lux_range(filter_name)
        text = f" on chip behind filter {filter_name}: {station.light.name} reaches"
        problems.append(_Problem(f"{text} {reach.lowest:.4g} to {reach.highest:.4g} {reach.unit} there", beyond))
        return np.empty(0)
    levels = [station.light.nearest(calibration.level_for(float(value), filter_name)) for value in different]
    return np.array(levels)[where]


def ranges_text(points: Sequence[int]) -> str:
    """Return numbers of points for people: ``point 3``, ``points 0-4, 7``."""
    parts: list[str] = []
    ordered = sorted(points)
    start = previous = ordered[0]
    for number in [*ordered[1:], None]:
        if number is not None and number == previous + 1:
            previous = number
            continue
        parts.append(f"{start}" if start == previous else f"{start}-{previous}")
        if number is not None:
            start = previous = number
    shown = parts if len(parts) <= 6 else [*parts[:5], f"... {len(ordered)} in all"]
    return f"point{'s' if len(ordered) > 1 else ''} {', '.join(shown)}"
