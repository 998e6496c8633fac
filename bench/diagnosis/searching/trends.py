"""Trends in what is left: a statistic that is off in the same direction at many points, each time by little.

The sum of all squares hardly sees what moves a few dozen of a thousand statistics by one standard error each. Their
mean does: of a view of one polarity all residuals are taken together, and how they change with light, contrast and
pulse width, and those at each light. What the free numbers can take up is left out (a score test along directions
that no effect has a name for).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from bench.diagnosis.fitting.chance import away_from_mean
from bench.diagnosis.searching.screen import basis_of, beyond, extended

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit
    from bench.diagnosis.recorded.summary import Label

    Floats = npt.NDArray[np.float64]

__all__ = ["Trend", "clear_trends"]

#: Views of which the run itself says at which phase they are looked at: there it is positive by chance, too.
_OWN_PHASE: Final = frozenset({"locked", "locked_across"})
#: Chance that a true model has any clear trend.
_ALPHA: Final = 0.01
#: How trends scatter is known from so many whole sensors at the most, and at the least, in the time of so many runs
#: of the base pixel.
_SENSORS, _FEWEST = 24, 8
_RUNS: Final = 48.0
#: A trend of which the free numbers leave a smaller part is none: what is left of it is not known well.
_LEFT: Final = 0.1


@dataclass(frozen=True, slots=True)
class Trend:
    """A view of one polarity that is off, everywhere or along an axis."""

    axis: str  #: as in :class:`~bench.diagnosis.result.Remainder`; "view": everywhere
    where: str
    size: float  #: rms, in standard errors of a statistic
    z: float  #: standard errors of the trend; negative: less was measured than expected


class _Pattern(NamedTuple):
    """Weights of some statistics, of unit mean square."""

    axis: str
    where: str
    members: npt.NDArray[np.int64]
    weights: Floats


class _Direction(NamedTuple):
    """A pattern beyond what the free numbers take up."""

    pattern: _Pattern
    unit: Floats  #: (n + k,) of independent residuals; see :func:`~bench.diagnosis.searching.screen.extended`
    length: float  #: standard errors, of a pattern that is off by one standard error of each statistic


def clear_trends(problem: Problem, one: Fit, seed: int) -> tuple[Trend, ...]:
    """Return the trends that chance does not make, the clearest first.

    Of so many that are looked at, a true model has any with a chance of 1 %: as long as they have little in common
    (Bonferroni; it has less where they do). What is frozen in the pixels is common to all points, and the covariance
    of each does not know of it: how trends scatter from sensor to sensor is simulated (parametric bootstrap).

    Parameters
    ----------
    seed
        Of these simulations.
    """
    from scipy.stats import norm

    directions = _directions(problem, one)
    residual = extended(one, one.whiten(one.residual, problem.measured.points)[:, None])[:, 0]
    z = np.array([d.unit @ residual for d in directions]) / math.sqrt(one.common)
    clear = float(norm.isf(0.5 * _ALPHA / max(len(directions), 1)))
    first = np.flatnonzero(np.abs(z) > clear)
    if not len(first):
        return ()
    z[first] /= np.maximum(_scatter(problem, one, [directions[i] for i in first], seed), 1.0)
    found = [
        Trend(directions[i].pattern.axis, directions[i].pattern.where, abs(float(z[i])) / directions[i].length,
              float(z[i]))
        for i in first
        if abs(z[i]) > clear
    ]  # fmt: skip
    return tuple(sorted(found, key=lambda t: -abs(t.z)))


def _scatter(problem: Problem, one: Fit, directions: Sequence[_Direction], seed: int) -> Floats:
    """Return the standard deviation of trends from one simulated sensor to the next."""
    models = one.models(problem)
    number = min(max(int(_RUNS / max(problem.cost(models), 1.0)), _FEWEST), _SENSORS)
    away = away_from_mean(problem, problem.whole_sensors(models, seed, number))
    known = np.where(one.known, away, 0.0).T
    white = extended(one, one.whiten(known, problem.measured.points))
    scores = np.stack([d.unit for d in directions]) @ white
    return np.asarray(np.sqrt(np.sum(scores**2, axis=1) / (number - 1.0)))


def _directions(problem: Problem, one: Fit) -> list[_Direction]:
    """Return what of all patterns the free numbers do not take up."""
    patterns = list(_patterns(problem.measured.labels, one.known))
    if not patterns:
        return []
    columns = np.zeros((len(one.residual), len(patterns)))
    for column, pattern in zip(columns.T, patterns, strict=True):
        column[pattern.members] = pattern.weights * one.deviation[pattern.members]
    white = one.whiten(columns, problem.measured.points)
    rest = beyond(basis_of(one, problem), extended(one, white))
    lengths = np.linalg.norm(rest, axis=0)
    seen = lengths > _LEFT * np.linalg.norm(white, axis=0)
    return [
        _Direction(pattern, rest[:, i] / lengths[i], float(lengths[i]))
        for i, pattern in enumerate(patterns)
        if seen[i]
    ]


def _patterns(labels: Sequence[Label], known: npt.NDArray[np.bool_]) -> Iterator[_Pattern]:
    """Yield what is looked for in each view of each polarity."""
    families: dict[tuple[str, str], list[int]] = {}
    for i, label in enumerate(labels):
        if known[i] and label.view not in _OWN_PHASE:
            families.setdefault((label.view, label.part), []).append(i)
    for (view, part), members in families.items():
        name = view if part == "both" else f"{view} {part}"
        yield from _of_family(name, np.array(members), [labels[i] for i in members])


def _of_family(name: str, members: npt.NDArray[np.int64], labels: Sequence[Label]) -> Iterator[_Pattern]:
    yield _Pattern("view", name, members, np.ones(len(members)))
    lights, light = np.unique([float(f"{label.baseline_lux:.3g}") for label in labels], return_inverse=True)
    along: Mapping[str, Floats] = {
        "illuminance": light.astype(np.float64),  # the dimmest may be no light at all
        "contrast": np.abs([label.log_contrast for label in labels]),
        "pulse_width": np.nan_to_num([label.width_s for label in labels]),
    }
    for axis, at in along.items():
        weights = at - float(np.mean(at))
        if np.ptp(at) > 0.0:
            yield _Pattern(axis, f"{name}, along it", members, weights / math.sqrt(float(np.mean(weights**2))))
    for i, lux in enumerate(lights if len(lights) > 1 else ()):
        there = members[light == i]
        yield _Pattern("illuminance", f"{name} at {lux:.3g} lux", there, np.ones(len(there)))
