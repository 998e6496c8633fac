"""What is left when the model is as good as it gets: along which axis, where, and how large."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.fitting.fitted import live
from bench.diagnosis.fitting.judging import more_than_chance
from bench.diagnosis.result import Remainder

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.recorded.summary import Label
    from bench.diagnosis.searching.state import State
    from bench.diagnosis.searching.trends import Trend
    from bench.store.data import PointData

__all__ = ["remainder_of"]

_SHOWN: Final = 6
#: Groups whose squares are larger than chance by fewer standard deviations are not named, but for the clearest.
_CLEAR: Final = 4.0

_OF_POINTS: Final[dict[str, Callable[[PointData], str]]] = {
    "illuminance": lambda p: f"{p.baseline_lux:.3g} lux",
    "contrast": lambda p: f"{p.log_contrast:.3g}",
    "pulse_width": lambda p: (
        f"{1e3 * float(np.median(p.pulse_stop_s - p.pulse_start_s)):.3g} ms"
        if p.pulse_start_s.size
        else "constant light"
    ),
    "nd_od": lambda p: f"{p.nd_od:g}",
}
_OF_STATISTICS: Final[dict[str, Callable[[Label], str | None]]] = {
    "view": lambda label: None if _is_of_time(label.view) else label.view,
    "polarity": lambda label: label.part,
    "time": lambda label: "second half" if _is_of_time(label.view) else None,
}


def _is_of_time(view: str) -> bool:
    return view.endswith("halves")


def remainder_of(problem: Problem, state: State) -> tuple[Remainder, ...]:
    """Return the groups of points, or of statistics, whose residuals are larger than chance, the clearest first.

    The size is the rms of the residuals in standard errors; of a trend, that of its part in them.
    """
    one = state.fit
    found = [_of_trend(t) for t in state.trends]
    for axis, name in _OF_POINTS.items():
        squares: dict[str, list[float]] = {}
        for point, where, root in zip(problem.points, problem.measured.points, one.roots, strict=True):
            r = (root @ one.residual[where])[live(root)] / math.sqrt(one.scale)
            squares.setdefault(name(point), []).extend(r * r)
        found += [_group(axis, where, values) for where, values in squares.items() if values]
    z = one.z
    for axis, of in _OF_STATISTICS.items():
        squares = {}
        for i in np.flatnonzero(one.known):
            place = of(problem.measured.labels[i])
            if place is not None:
                squares.setdefault(place, []).append(float(z[i] ** 2))
        found += [_group(axis, where, values) for where, values in squares.items()]
    found.sort(key=lambda r: -r.z)
    clear = [r for r in found if r.z > _CLEAR]  # trends are
    return tuple(clear[:_SHOWN] or found[:1])


def _of_trend(one: Trend) -> Remainder:
    """Return a trend; a view that is the second half of a recording less the first is told as what it is."""
    of_time = one.axis == "view" and _is_of_time(one.where.split()[0])
    axis, where = ("time", "second half") if of_time else (one.axis, one.where)
    return Remainder(axis, where, one.size, abs(one.z))


def _group(axis: str, where: str, squares: list[float]) -> Remainder:
    n = len(squares)
    total = float(np.sum(squares))
    return Remainder(axis, where, math.sqrt(total / n), more_than_chance(total, n))
