"""Residuals against every independent variable: where a model fails, in which direction, and how that changes.

Along an axis residuals are taken together value by value. Their mean square says how far off the model is there (1
for a true model), their mean in which direction. What both scatter by chance follows from the correlations of the
statistics of a point. Pixels keep what is frozen in them from point to point, which is not counted here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from bench.diagnosis.views.registry import shown_views

if TYPE_CHECKING:
    from collections.abc import Container, Hashable, Iterable, Sequence

    import numpy.typing as npt

    from bench.diagnosis.comparison import Residual, ResidualsByStep

    Floats = npt.NDArray[np.float64]

__all__ = [
    "ALL_VIEWS",
    "AXES",
    "UNITS",
    "Axis",
    "Bin",
    "Place",
    "by_axis",
    "first_places",
    "in_both",
    "told_bins",
    "worst_places",
]

Axis = Literal[
    "anywhere", "illuminance", "contrast", "pulse width", "events at once", "polarity", "ND filter", "order",
    "halves",
]  # fmt: skip
AXES: Final[tuple[Axis, ...]] = (
    "anywhere", "illuminance", "contrast", "pulse width", "events at once", "polarity", "ND filter", "order",
    "halves",
)  # fmt: skip
#: In what an axis is numbered.
UNITS: Final[dict[Axis, str]] = {
    "anywhere": "", "illuminance": "lux", "contrast": "ln", "pulse width": "s", "events at once": "1",
    "polarity": "", "ND filter": "OD", "order": "1", "halves": "",
}  # fmt: skip
#: The view of a bin that takes all views together.
ALL_VIEWS: Final = "all"
#: More values than this are taken together, in groups of neighbours.
_MOST_BINS: Final = 8
_HALVES: Final = frozenset({"halves", "background_halves"})
_POLARITIES: Final = ("on", "off", "both")
#: A change along an axis is told where its ends differ by so many standard errors.
_TOLD: Final = 4.0
#: Up to so many standard errors a mean residual is taken for chance.
_CHANCE: Final = 2.5
#: Rank correlation with the axis above which a change is said to go one way.
_ONE_WAY: Final = 0.6
_FEWEST_PLACES: Final = 2


@dataclass(frozen=True, slots=True)
class Bin:
    """Residuals at one value of an axis, or at neighbouring ones.

    The axis `events at once` counts the events that all pixels together send in answer to one pulse, `order` the
    points as they were taken; `halves` has the statistics that hold the second half of a recording against the first,
    and `anywhere` takes all together.
    """

    axis: Axis
    view: str  #: id of a view, or :data:`ALL_VIEWS`
    low: float  #: lowest value of the axis that is in it; the number of the polarity
    high: float
    count: int
    mean: float  #: of z
    mean_sd: float  #: of that, by chance
    square: float  #: mean of z^2
    square_sd: float

    @property
    def place(self) -> float:
        """Where it stands on the axis."""
        return math.sqrt(self.low * self.high) if self.low > 0.0 else 0.5 * (self.low + self.high)


@dataclass(frozen=True, slots=True)
class Change:
    """How the residuals of one view and polarity change along an axis."""

    axis: Axis
    way: Literal["grows", "falls", "peaks"]  #: towards larger values, or at a value between
    at: float  #: where they are largest
    flat_above: float | None  #: from this value on they are chance
    flat_below: float | None


@dataclass(frozen=True, slots=True)
class Place:
    """Where a model fails: the worst residual of a view and polarity, and how its like change along each axis."""

    worst: Residual
    changes: tuple[Change, ...]


def by_axis(residuals: Sequence[Residual], correlation: Floats | None = None) -> tuple[Bin, ...]:
    """Return the residuals along every axis: of all views together, and of each.

    Parameters
    ----------
    correlation
        (n, n) of the residuals; None where they are independent.
    """
    views = list(dict.fromkeys(r.view for r in residuals))
    found: list[Bin] = []
    for axis in AXES:
        values = np.array([_value(axis, r) for r in residuals], np.float64)
        groups = _groups(axis, values)
        found += (_bin(axis, ALL_VIEWS, values, where, residuals, correlation) for where in groups)
        for view in views:
            mine = np.array([r.view == view for r in residuals], np.bool_)
            parts = [where[mine[where]] for where in groups]
            found += (_bin(axis, view, values, p, residuals, correlation) for p in parts if p.size)
    return tuple(found)


def told_bins(bins: Sequence[Bin], axis: Axis) -> list[Bin]:
    """Return what is told along an axis: each view `anywhere`, else all views together if it has several values."""
    if axis == "anywhere":
        return [b for b in bins if b.axis == axis and b.view != ALL_VIEWS]
    mine = [b for b in bins if b.axis == axis and b.view == ALL_VIEWS]
    return mine if len(mine) > 1 or axis == "halves" else []


def in_both(
    one: tuple[Sequence[Residual], Floats | None], other: tuple[Sequence[Residual], Floats | None]
) -> tuple[tuple[Bin, ...], tuple[Bin, ...]]:
    """Return the residuals of two models along every axis, of those statistics alone that both know.

    Parameters
    ----------
    one, other
        Residuals, and their correlation where it is known.
    """
    known = {_statistic(r) for r in one[0]} & {_statistic(r) for r in other[0]}
    first, second = (by_axis(*_those(known, *each)) for each in (one, other))
    return first, second


def _statistic(one: Residual) -> Hashable:
    return one.view, one.part, one.point, one.log_contrast, f"{one.width_s:g}"  # no two NaN are the same


def _those(
    which: Container[Hashable], residuals: Sequence[Residual], correlation: Floats | None
) -> tuple[list[Residual], Floats | None]:
    mine = [i for i, r in enumerate(residuals) if _statistic(r) in which]
    return [residuals[i] for i in mine], None if correlation is None else correlation[np.ix_(mine, mine)]


def _value(axis: Axis, one: Residual) -> float:
    """Return where a residual stands on an axis; NaN if nowhere."""
    if axis == "anywhere":
        return 0.0
    if axis == "halves":
        return 0.0 if one.view in _HALVES else math.nan
    if axis == "polarity":
        return float(_POLARITIES.index(one.part))
    if axis == "contrast":
        return one.log_contrast if one.log_contrast > 0.0 else math.nan
    if axis == "order":
        return float(one.point)
    if axis == "events at once":
        return one.at_once
    return {"illuminance": one.baseline_lux, "pulse width": one.width_s, "ND filter": one.nd_od}[axis]


def _groups(axis: Axis, values: Floats) -> list[npt.NDArray[np.intp]]:
    """Return the places of the residuals of each bin, along the axis."""
    rounded = np.array([float(f"{v:.3g}") if math.isfinite(v) else math.nan for v in values])
    if axis in ("order", "polarity"):
        rounded = values
    distinct = np.unique(rounded[np.isfinite(rounded)])
    parts = np.array_split(distinct, min(_MOST_BINS, distinct.size)) if distinct.size else []
    return [np.flatnonzero(np.isin(rounded, part)) for part in parts]


def _bin(
    axis: Axis, view: str, values: Floats, where: npt.NDArray[np.intp], residuals: Sequence[Residual],
    correlation: Floats | None,
) -> Bin:  # fmt: skip
    z = np.array([residuals[i].z for i in where])
    n = z.size
    mutual = np.eye(n) if correlation is None else correlation[np.ix_(where, where)]
    return Bin(
        axis=axis,
        view=view,
        low=float(values[where].min()),
        high=float(values[where].max()),
        count=n,
        mean=float(z.mean()),
        mean_sd=math.sqrt(max(float(mutual.sum()), 0.0)) / n,
        square=float(np.mean(z**2)),
        square_sd=math.sqrt(2.0 * float(np.sum(mutual**2))) / n,
    )


def worst_places(
    residuals: Sequence[Residual], correlation: Floats | None = None, most: int = 5, least_z: float = 3.5
) -> tuple[Place, ...]:
    """Return where the model fails most, one place for each view by which fits go and polarity, the worst first.

    Parameters
    ----------
    least_z
        Residuals that are nearer than this are nothing to speak of.
    """
    groups: dict[Hashable, list[int]] = {}
    said_by_others = {view.id for view in shown_views()}
    for i, one in enumerate(residuals):
        if one.view not in said_by_others:
            groups.setdefault((one.view, one.part), []).append(i)
    found = []
    for mine in groups.values():
        worst = max(mine, key=lambda i: abs(residuals[i].z))
        if abs(residuals[worst].z) >= least_z:
            found.append((worst, mine))
    found.sort(key=lambda pair: -abs(residuals[pair[0]].z))
    return tuple(_place(worst, mine, residuals, correlation) for worst, mine in found[:most])


def first_places(residuals: ResidualsByStep) -> dict[int, Place]:
    """Return where the model of each step fails most, by the number of the step."""
    found = {number: worst_places(mine, mutual, most=1) for number, (mine, mutual) in residuals.items()}
    return {number: places[0] for number, places in found.items() if places}


def _place(worst: int, mine: Sequence[int], residuals: Sequence[Residual], correlation: Floats | None) -> Place:
    alike = [residuals[i] for i in mine]
    mutual = None if correlation is None else correlation[np.ix_(mine, mine)]
    axes: tuple[Axis, ...] = ("illuminance", "contrast", "pulse width", "ND filter", "order")
    along = {axis: [b for b in by_axis(alike, mutual) if b.axis == axis and b.view == ALL_VIEWS] for axis in axes}
    # Points are mostly taken level by level: the order tells something of its own only where nothing else changes.
    if any(len(along[axis]) > 1 for axis in axes[:-1]):
        along["order"] = []
    sign = math.copysign(1.0, residuals[worst].z)
    return Place(residuals[worst], tuple(c for a, bins in along.items() if (c := _change(a, bins, sign)) is not None))


def _change(axis: Axis, bins: Sequence[Bin], sign: float) -> Change | None:
    """Return how residuals change along an axis; None where they do not, beyond chance."""
    if len(bins) < _FEWEST_PLACES:
        return None
    mean = np.array([sign * b.mean for b in bins])
    sd = np.array([b.mean_sd for b in bins])
    top, bottom = int(np.argmax(mean)), int(np.argmin(mean))
    if mean[top] - mean[bottom] < _TOLD * math.hypot(sd[top], sd[bottom]):
        return None
    rank = _rank_correlation(mean)
    way: Literal["grows", "falls", "peaks"] = "grows" if rank > _ONE_WAY else "falls" if rank < -_ONE_WAY else "peaks"
    chance = np.abs(mean) < _CHANCE * sd
    return Change(axis, way, bins[top].place, *_flat(bins, chance))


def _flat(bins: Sequence[Bin], chance: Iterable[np.bool_]) -> tuple[float | None, float | None]:
    """Return from where on, and up to where, there is nothing but chance."""
    quiet = [bool(c) for c in chance]
    if all(quiet):
        return None, None
    last = max(i for i, c in enumerate(quiet) if not c)
    first = min(i for i, c in enumerate(quiet) if not c)
    above = bins[last + 1].low if last + 1 < len(bins) else None
    below = bins[first - 1].high if first > 0 else None
    return above, below


def _rank_correlation(values: Floats) -> float:
    ranks = np.argsort(np.argsort(values)).astype(np.float64)
    return float(np.corrcoef(np.arange(values.size), ranks)[0, 1])
