"""What differs between the points of two runs: which there are, what they were asked for, what was read back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from bench.catalogue.tree_diff import Difference, tree_differences

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from bench.store import Run
    from bench.store.data import PointData

__all__ = ["PointFacts", "facts_of", "point_differences", "reading_differences"]

#: What is measured or comes by chance, and is never quite the same; ranges of it are told, and are no difference.
_READINGS: Final = ("temperature_c", "bench_lux_before", "bench_lux_after")
#: How the edges were found in the recording: another in each.
_TIME_AXIS: Final = ("time_offset_s", "time_rate_ppm", "time_residual_s")
#: What makes two points the same one, of whatever setting of the sensor; the first three tell the measurement.
_CONDITION: Final = ("measurement", "waveform", "polarity", "baseline_lux", "log_contrast", "nd_od")
#: What says when and by which dice a point was taken.
_NOT_SETTINGS: Final = {*_READINGS, "format", "index", "started", "seed", *_TIME_AXIS}


@dataclass(frozen=True, slots=True)
class PointFacts:
    """What a point of a run says of itself."""

    index: int
    settings: Mapping[str, Any]
    readings: Mapping[str, float]

    @property
    def condition(self) -> tuple[str, ...]:
        """What was asked for, but for settings of the sensor: points of two runs that have it alike are the same."""
        return tuple(_digits(self.settings.get(name)) for name in _CONDITION)

    @property
    def measurement(self) -> tuple[str, ...]:
        """To which measurement it belongs."""
        return tuple(_digits(self.settings.get(name)) for name in _CONDITION[:3])

    def __str__(self) -> str:
        """Return number and condition for people."""
        what, lux = self.settings.get("measurement", self.settings["waveform"]), self.settings["baseline_lux"]
        return f"point {self.index} ({what}, {lux:.4g} lux, log contrast {self.settings['log_contrast']:.3g})"


def facts_of(run: Run) -> list[PointFacts]:
    """Return what the points of `run` say, in the order of the plan."""
    return [
        PointFacts(
            point.index,
            _settings(point),
            {name: _number(point.attributes.get(name)) for name in _READINGS},
        )
        for point in run.points()
    ]


def _settings(point: PointData) -> dict[str, Any]:
    attributes = {name: value for name, value in point.attributes.items() if name not in _NOT_SETTINGS}
    masked = {"masked_pixels": len(point.masked)} if len(point.masked) else {}
    return {**attributes, **masked, **{f"bias.{name}": value for name, value in point.bias.items()}}


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else math.nan


def _digits(value: Any) -> str:
    return f"{value:.5g}" if isinstance(value, float | int) else str(value)


def point_differences(left: Sequence[PointFacts], right: Sequence[PointFacts]) -> list[Difference]:
    """Return what differs: the number of points, which only one has, then one line for each setting.

    A setting that differs at several points is one difference: its values at the first of them, and at which.
    """
    pairs = _pairs(left, right)
    alone = [_which(_not_in(side, (pair[i] for pair in pairs))) for i, side in enumerate((left, right))]
    found = [Difference("taken", len(left), len(right)), Difference("only in one of them", *alone)]
    by_name: dict[str, list[tuple[PointFacts, Difference]]] = {}
    for one, other in pairs:
        for difference in tree_differences(dict(one.settings), dict(other.settings)):
            by_name.setdefault(difference.path, []).append((one, difference))
    for name, at in by_name.items():
        where = "all points" if len(at) == len(pairs) > 1 else _which([point for point, _ in at])
        found.append(Difference(f"{name} at {where}", at[0][1].left, at[0][1].right))
    return [one for one in found if one.left != one.right]


def _pairs(left: Sequence[PointFacts], right: Sequence[PointFacts]) -> list[tuple[PointFacts, PointFacts]]:
    """Return the points that belong together: of the same condition, and of the rest those of the same number.

    The number alone would not do: one contrast more, and all points after it have another one.
    """
    waiting: dict[tuple[str, ...], list[PointFacts]] = {}
    for point in right:
        waiting.setdefault(point.condition, []).append(point)
    pairs = [(point, same.pop(0)) for point in left if (same := waiting.get(point.condition))]
    rest = {point.index: point for point in _not_in(right, (other for _, other in pairs))}
    for point in _not_in(left, (one for one, _ in pairs)):
        other = rest.get(point.index)
        if other is not None and other.measurement == point.measurement:
            pairs.append((point, other))
    return sorted(pairs, key=lambda pair: pair[0].index)


def _not_in(points: Sequence[PointFacts], others: Iterable[PointFacts]) -> list[PointFacts]:
    numbers = {point.index for point in others}
    return [point for point in points if point.index not in numbers]


def _which(points: Sequence[PointFacts]) -> str:
    from bench.run.plan import ranges_text

    if not points:
        return "none"
    return str(points[0]) if len(points) == 1 else ranges_text([point.index for point in points])


def reading_differences(left: Sequence[PointFacts], right: Sequence[PointFacts]) -> list[Difference]:
    """Return the ranges of what was measured beside the events, where they are not the same."""
    found = []
    for name in _READINGS:
        ranges = [_range([point.readings[name] for point in side]) for side in (left, right)]
        if ranges[0] != ranges[1]:
            found.append(Difference(name, *ranges))
    return found


def _range(readings: Iterable[float]) -> str:
    values = [value for value in readings if math.isfinite(value)]
    if not values:
        return "not known"
    lowest, highest = f"{min(values):.4g}", f"{max(values):.4g}"
    return lowest if lowest == highest else f"{lowest} to {highest}"
