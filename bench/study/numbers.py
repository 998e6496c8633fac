"""What the grids say: which noise is acceptable, and which reset and test pulses are best."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Final

from bench.analysis.results import Estimate
from bench.study.claims import number_of, true_threshold

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.analysis.results import SCurve
    from bench.study.run import StudyResult

__all__ = [
    "ACCEPTABLE",
    "BiasPoint",
    "ResetPoint",
    "acceptable_noise",
    "bias_points",
    "recommendations",
    "reset_points",
]

ACCEPTABLE: Final = 0.05  #: relative bias of the intercept
_LEAST_REARMED: Final = 0.99  #: share of the resets
_SAME_PLATEAU: Final = 0.005
_STIMULI: Final = {"square": "square wave", "reset_test": "reset and test pulses"}


@dataclass(frozen=True, slots=True)
class BiasPoint:
    """The intercept of one pixel with one stimulus."""

    stimulus: str
    corner_hz: float
    theta_off: float
    noise_rms: float
    rate: Estimate  #: background, ON and OFF together, Hz
    bias: Estimate  #: intercept over the larger threshold, less 1


@dataclass(frozen=True, slots=True)
class ResetPoint:
    """One setting of the reset and test pulses."""

    axis: str  #: which of their quantities was varied
    value: float
    bias: Estimate  #: intercept over the threshold, less 1
    plateau: Estimate
    rearmed: float  #: share of the resets that were answered


def _relative(estimate: Estimate, truth: float) -> Estimate:
    low, high = estimate.low / truth - 1.0, estimate.high / truth - 1.0
    return Estimate(estimate.value / truth - 1.0, low, high, "1", estimate.note)


def bias_points(result: StudyResult) -> tuple[BiasPoint, ...]:
    """Return what the grid `bias` found, for each stimulus; empty where it was not run."""
    found = []
    for variant in result.of_grid("bias"):
        background = result.outcomes[variant.name, "background"]
        truth = max(true_threshold(variant.pixel, p) for p in ("on", "off"))
        for stimulus in _STIMULI:
            curve = result.outcomes[variant.name, stimulus].curve("on")
            if curve is None:
                continue
            found.append(
                BiasPoint(
                    stimulus=stimulus,
                    corner_hz=variant.at["corner_hz"],
                    theta_off=variant.at["theta_off"],
                    noise_rms=variant.at["noise_rms"],
                    rate=number_of(background, "rate", "both", variant.pixel),
                    bias=_relative(curve.intercept, truth),
                )
            )
    return tuple(found)


def acceptable_noise(points: Sequence[BiasPoint]) -> list[str]:
    """Return one sentence for each stimulus, corner and imbalance: at which noise the bias stays within 5 %.

    Little noise moves the intercept to the right (what is memorised is noisy, and nothing helps a step that is too
    small), much noise to the left, so there may be a lower end too.
    """
    groups: dict[tuple[str, float, float], list[BiasPoint]] = {}
    for point in points:
        groups.setdefault((point.stimulus, point.corner_hz, point.theta_off), []).append(point)
    return [
        f"{_STIMULI[stimulus]}, {corner:g} Hz, OFF threshold {off:g}: {_range(mine)}"
        for (stimulus, corner, off), mine in groups.items()
    ]


def _range(points: Sequence[BiasPoint]) -> str:
    points = sorted((p for p in points if math.isfinite(p.bias.value)), key=lambda p: p.noise_rms)
    if not points:
        return "no intercept was found"
    good = [i for i, p in enumerate(points) if abs(p.bias.value) <= ACCEPTABLE]
    if not good:
        least = min(points, key=lambda p: abs(p.bias.value))
        return f"nowhere; the least bias is {least.bias.value:+.0%}, at {_noise(least)}"
    stretches = [[i for _, i in run] for _, run in groupby(enumerate(good), key=lambda place: place[1] - place[0])]
    text = ", and ".join(_stretch(points, run[0], run[-1]) for run in stretches)
    return text if good[-1] < len(points) - 1 else f"{text}, the most that was taken"


def _stretch(points: Sequence[BiasPoint], first: int, last: int) -> str:
    """Return from where to where, in words; the first place that was taken is as good as no noise."""
    if first == 0:
        return f"up to {_noise(points[last])}"
    return f"from {_noise(points[first])} to {_noise(points[last])}"


def _noise(point: BiasPoint) -> str:
    rate = f"{point.rate.value:.2g} Hz" if point.rate.value > 0.0 else f"less than {point.rate.high:.1g} Hz"
    return f"rms {point.noise_rms:g} (background {rate})"


def reset_points(result: StudyResult) -> tuple[ResetPoint, ...]:
    """Return what the grid `reset` found; empty where it was not run."""
    found = []
    for variant in result.of_grid("reset"):
        curve = result.outcomes[variant.name, "reset_test"].curve("on")
        if curve is not None:
            ((axis, value),) = variant.at.items()
            bias = _relative(curve.intercept, true_threshold(variant.pixel, "on"))
            found.append(ResetPoint(axis, value, bias, _plateau(curve), curve.answered_resets))
    return tuple(found)


def _plateau(curve: SCurve) -> Estimate:
    """Return the plateau; where no curve could be fitted, the share at the highest contrast."""
    if math.isfinite(curve.plateau.value):
        return curve.plateau
    return Estimate(
        float(curve.probability[-1]), float(curve.low[-1]), float(curve.high[-1]), "1", "highest contrast"
    )


def recommendations(points: Sequence[ResetPoint]) -> list[str]:
    """Return what to choose for each quantity of the reset and test pulses, from the numbers alone."""
    by_axis: dict[str, list[ResetPoint]] = {}
    for point in points:
        by_axis.setdefault(point.axis, []).append(point)
    found = []
    for axis, mine in by_axis.items():
        mine.sort(key=lambda p: p.value)
        choice = _least_bias(mine) if axis in ("test_s", "window_s") else _smallest_enough(mine)
        found.append(f"{_NAMES[axis]}: {choice}")
    return found


_NAMES: Final = {
    "reset_contrast": "reset amplitude (linear)",
    "gap_s": "gap, s",
    "reset_s": "length of the reset pulse, s",
    "test_s": "length of the test pulse and of its window, s",
    "window_s": "response window, s",
}


def _smallest_enough(points: Sequence[ResetPoint]) -> str:
    """Return the smallest value that re-arms the pixels and reaches the best plateau."""
    best = max(p.plateau.value for p in points)
    enough = [p for p in points if p.rearmed >= _LEAST_REARMED and p.plateau.value >= best - _SAME_PLATEAU]
    if not enough:
        return f"no value re-arms {_LEAST_REARMED:.0%} of the pixels"
    first = enough[0]
    lower = [p for p in points if p.value < first.value]
    if not lower:
        return f"every value taken will do, {first.value:g} too ({first.rearmed:.1%} of the resets are answered)"
    return (
        f"{first.value:g} or more: {first.rearmed:.1%} of the resets are answered and the plateau is "
        f"{first.plateau.value:.3f}; at {lower[-1].value:g} {lower[-1].rearmed:.1%} and {lower[-1].plateau.value:.3f}"
    )


def _least_bias(points: Sequence[ResetPoint]) -> str:
    """Return the value with the least bias of the intercept among those that lose no answers."""
    best = max(p.plateau.value for p in points)
    whole = [p for p in points if math.isfinite(p.bias.value) and p.plateau.value >= best - _SAME_PLATEAU]
    if not whole:
        return "no value gives an intercept"
    chosen, longest = min(whole, key=lambda p: abs(p.bias.value)), whole[-1]
    return (
        f"{chosen.value:g}: the intercept is off by {chosen.bias.value:+.1%}; at {longest.value:g} by "
        f"{longest.bias.value:+.1%}"
    )
