"""What a protocol would run into: the rules, one point or one set of points at a time.

All follow from what the pixel is expected to be (:mod:`protocols.expected`) and from what the light source can do. A
rule that needs something that is not known says nothing; :data:`NEEDED` says which.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.run.foresight import ContrastError
from protocols import stimulus_of
from protocols.expected import Expected, log_response, off_impossible_at_lux, reset_return
from protocols.points import ResetTestTiming, SquareTiming

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator

    from bench.run.plan import PlannedPoint
    from drivers.interfaces import LightSource
    from protocols.points import Point

__all__ = ["NEEDED", "Observation", "observe_contrast", "observe_curve", "observe_point", "observe_settings"]

#: The return of a reset pulse should exceed the threshold by this part of it: noise and mismatch need room.
REARM_MARGIN: Final = 0.1
#: Thresholds that differ by less than this part are taken for equal.
EQUAL_THRESHOLDS: Final = 0.01
#: A pixel has settled after so many time constants.
SETTLED_TAUS: Final = 5.0
#: Settings that go through the bias map.
_PHYSICAL: Final = ("theta_on", "theta_off", "refractory_s", "bandwidth_hz")
#: A contrast that is off by more than this part is another contrast. What was set is recorded, whatever it is.
CONTRAST_OFF: Final = 0.05
#: Rounding of times and thresholds that were computed from the same numbers.
_RELATIVE: Final = 1e-6


@dataclass(frozen=True, slots=True)
class Observation:
    """One thing that a rule saw at one point."""

    kind: str  #: which rule
    point: int
    message: str  #: for people, about this point
    badness: float  #: the message of the worst point stands for all


def _is_reset_test(point: Point) -> bool:
    return isinstance(point.timing, ResetTestTiming)


def _is_curve(point: Point) -> bool:
    return point.polarity in ("on", "off") and bool(point.log_contrast) and point.baseline_lux > 0.0


def _has_parts(point: Point) -> bool:
    return isinstance(point.timing, ResetTestTiming | SquareTiming)


#: What rules need to be known of the pixel: in words what they find out, and whether they apply to a point.
NEEDED: Final[dict[str, tuple[str, Callable[[Point], bool]]]] = {
    "dark_light_lux": (
        "whether the reset re-arms the pixel, and whether the contrasts reach the threshold",
        lambda p: _is_reset_test(p) or _is_curve(p),
    ),
    "theta_on": ("what follows from the ON threshold", _has_parts),
    "theta_off": ("what follows from the OFF threshold", _has_parts),
    "bandwidth_hz": ("whether gaps and pulses are long enough", _has_parts),
}


def observe_point(point: Point, expected: Expected, light: LightSource) -> Iterator[Observation]:
    """Yield what is wrong with `point` on its own, for a sensor that is as `expected` at its settings."""
    if isinstance(point.timing, ResetTestTiming):
        yield from _reset_does_not_rearm(point, expected)
    if isinstance(point.timing, SquareTiming):
        yield from _square_shows_the_other(point, expected)
    yield from _pulse_too_short(point, expected)
    yield from _light_too_slow(point, light)


def _reset_does_not_rearm(point: Point, expected: Expected) -> Iterator[Observation]:
    timing = point.timing
    up = isinstance(timing, ResetTestTiming) and timing.reset_direction == "up"
    theta = expected.theta_off if up else expected.theta_on
    if theta is None or expected.dark_light_lux is None or point.baseline_lux <= 0.0:
        return
    step = reset_return(point, expected.dark_light_lux)
    if step < theta * (1.0 + REARM_MARGIN) * (1.0 - _RELATIVE):
        name = "OFF" if up else "ON"
        yield Observation(
            "reset_does_not_rearm",
            point.index,
            f"the reset does not re-arm the pixel: at {point.baseline_lux:.4g} lux with "
            f"{expected.dark_light_lux:.4g} lux of dark light its return is a step of {step:.3f} ln, "
            f"the {name} threshold is {theta:.3f}, and {100 * REARM_MARGIN:.0f} % more are wanted; "
            "use a larger reset contrast",
            theta / step if step > 0.0 else math.inf,
        )


def _square_shows_the_other(point: Point, expected: Expected) -> Iterator[Observation]:
    """Both curves of a square wave step at the larger of the two thresholds; the other one is not measured."""
    if expected.theta_on is None or expected.theta_off is None:
        return
    (smaller, hidden), (larger, shown) = sorted([(expected.theta_on, "on"), (expected.theta_off, "off")])
    if smaller > larger * (1.0 - EQUAL_THRESHOLDS):
        yield Observation(
            "square_cannot_tell_thresholds",
            point.index,
            f"a square wave cannot tell thresholds that are equal ({smaller:.3f} and {larger:.3f} ln): each pixel "
            "shows the larger of its two in both curves; use reset_test for each",
            1.0,
        )
        return
    yield Observation(
        "square_shows_other_threshold",
        point.index,
        f"a square wave shows the less sensitive threshold in both curves, {shown.upper()} ({larger:.3f} ln); "
        f"the {hidden.upper()} threshold ({smaller:.3f} ln) stays unseen: use reset_test for it",
        larger / smaller,
    )


def _pulse_too_short(point: Point, expected: Expected) -> Iterator[Observation]:
    if expected.bandwidth_hz is None:
        return
    tau_s = 1.0 / (2.0 * math.pi * expected.bandwidth_hz)
    needed_s = (expected.refractory_s or 0.0) + SETTLED_TAUS * tau_s
    for name, length_s in _parts(point):
        if length_s < needed_s * (1.0 - _RELATIVE):
            yield Observation(
                f"{name}_too_short",
                point.index,
                f"the {name} of {length_s:.4g} s is shorter than the refractory period and {SETTLED_TAUS:.0f} time "
                f"constants of the pixel ({needed_s:.4g} s)",
                needed_s / length_s,
            )


def _parts(point: Point) -> Iterable[tuple[str, float]]:
    """Return name and length (s) of the stretches of constant light within a period."""
    timing = point.timing
    if isinstance(timing, ResetTestTiming):
        return (("gap", timing.gap_s), ("reset pulse", timing.reset_s), ("test pulse", timing.test_s))
    if isinstance(timing, SquareTiming):
        period_s = 1.0 / timing.frequency_hz
        return (("bright part", timing.duty * period_s), ("dark part", (1.0 - timing.duty) * period_s))
    return ()


def _light_too_slow(point: Point, light: LightSource) -> Iterator[Observation]:
    edges_s = stimulus_of(point).t_s
    if len(edges_s) < 2:
        return
    shortest_s = float(np.diff(edges_s).min())
    host = light.timing == "host"
    needed_s = light.edge_time_s + (light.settling_s if host else 0.0)
    if shortest_s < needed_s * (1.0 - _RELATIVE):
        what = "is timed by the host and needs" if host else "needs"
        yield Observation(
            "light_too_slow",
            point.index,
            f"the light is to change every {shortest_s:.4g} s, but {light.name} {what} {needed_s:.4g} s for an edge"
            + (" and to settle" if host else ""),
            needed_s / shortest_s,
        )


def observe_settings(point: Point, uncalibrated: Collection[str]) -> Iterator[Observation]:
    """Yield that `point` asks for a quantity whose bias curve was not measured on this sensor.

    Parameters
    ----------
    point
        Any.
    uncalibrated
        Those quantities.
    """
    asked = [name for name in _PHYSICAL if name in uncalibrated and getattr(point.settings, name) is not None]
    if asked:
        yield Observation(
            "settings_not_calibrated",
            point.index,
            f"{' and '.join(asked)}: set through the station's bias map, which was not measured on this sensor "
            "(calibrated: false), so that the sensor may be far from what is asked for; measure it with the protocol "
            "bias_calibration and evs-bench calibrate-biases",
            float(len(asked)),
        )


def observe_contrast(planned: PlannedPoint) -> Iterator[Observation]:
    """Yield that the light source, whose levels have steps, sets quite another contrast than a point asks for."""
    error = ContrastError.of(planned)
    if error is not None and error.relative > CONTRAST_OFF:
        yield Observation(
            "contrast_in_steps", error.point, f"the levels of the light have steps: {error}", error.relative
        )


def observe_curve(points: list[Point], expected: Expected) -> Iterator[Observation]:
    """Yield what is wrong with the points of one curve taken together: contrasts that never reach the threshold.

    `points` share everything but the contrast.
    """
    dark = expected.dark_light_lux
    polarity, baseline_lux = points[0].polarity, points[0].baseline_lux
    theta = {"on": expected.theta_on, "off": expected.theta_off}.get(polarity)
    if theta is None or dark is None or baseline_lux <= 0.0 or not points[0].log_contrast:
        return
    if polarity == "off" and _below(baseline_lux, off_impossible_at_lux(theta, dark)):
        text = (
            f"no OFF event is possible from {baseline_lux:.4g} lux, not even by a step into darkness: with "
            f"{dark:.4g} lux of dark light and a threshold of {theta:.3f} ln the level must be above "
            f"{off_impossible_at_lux(theta, dark):.4g} lux"
        )
        yield from (Observation("off_impossible", p.index, text, 1.0 / baseline_lux) for p in points)
        return
    largest = max(points, key=lambda p: p.log_contrast)
    step = abs(log_response(*_levels(largest), dark))
    if step < theta * (1.0 - _RELATIVE):
        text = (
            f"no contrast reaches the {polarity.upper()} threshold of {theta:.3f} ln at {baseline_lux:.4g} lux: the "
            f"largest, {largest.log_contrast:.3f}, is a step of {step:.3f} ln with {dark:.4g} lux of dark light"
        )
        yield from (Observation("threshold_not_reached", p.index, text, theta / step) for p in points)


def _below(value: float, limit: float) -> bool:
    return value <= limit * (1.0 + _RELATIVE)


def _levels(point: Point) -> tuple[float, float]:
    """Return the light before and after the leading edge of the test pulse, lux."""
    # The baseline of a square wave is its lower level, whatever is tested: an OFF step starts at the upper one.
    if point.waveform == "square" and point.polarity == "off":
        return point.baseline_lux * math.exp(point.log_contrast), point.baseline_lux
    sign = -1.0 if point.polarity == "off" else 1.0
    return point.baseline_lux, point.baseline_lux * math.exp(sign * point.log_contrast)
