"""The points of a run by what they have in common but for the bias that was swept."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from bench.analysis.results import ResponsePolarity, ResponseRow
    from bench.store.data import PointData

__all__ = ["BIASES", "Swept", "swept_curves", "swept_points"]

#: Which bias of a Metavision sensor (EVK4) sets which quantity.
BIASES: Final = {
    "theta_on": "bias_diff_on",
    "theta_off": "bias_diff_off",
    "refractory_s": "bias_refr",
    "bandwidth_hz": "bias_fo",
}

_Place = tuple[tuple[tuple[str, float], ...], float, float]


@dataclass(frozen=True, slots=True)
class Swept:
    """The answers at one offset of the bias that was swept."""

    offset: int
    rows: tuple[ResponseRow, ...]  #: of one S-curve
    bias: Mapping[str, float]  #: all biases


def swept_points(points: Iterable[PointData], biases: Collection[str]) -> list[PointData]:
    """Return the points at which some biases were swept while all else stayed: the largest such group.

    Parameters
    ----------
    points
        The points in question.
    biases
        Those that may differ within the group.
    """
    groups: dict[_Place, list[PointData]] = {}
    for point in points:
        if all(name in point.bias for name in biases):
            groups.setdefault(_place(point, biases), []).append(point)
    return max(groups.values(), key=lambda group: _extent(group, biases), default=[])


def _extent(group: Sequence[PointData], biases: Collection[str]) -> tuple[int, float]:
    """Return by how much a group is the larger one: offsets, then light."""
    return len({tuple(p.bias[name] for name in biases) for p in group}), group[0].baseline_lux


def _place(point: PointData, biases: Collection[str]) -> _Place:
    rest = tuple(sorted((name, value) for name, value in point.bias.items() if name not in biases))
    return rest, point.baseline_lux, point.nd_od


def swept_curves(
    rows: Sequence[ResponseRow], points: Mapping[int, PointData], polarity: ResponsePolarity, bias: str
) -> list[Swept]:
    """Return the reset/test curves of one polarity at the offsets of one bias, ascending, the others at rest."""
    mine = [row for row in rows if row.key.waveform == "reset_test" and row.key.polarity == polarity]
    group = {p.index for p in swept_points((points[row.point] for row in mine), (bias,))}
    curves: dict[int, list[ResponseRow]] = {}
    for row in mine:
        if row.point in group:
            curves.setdefault(round(points[row.point].bias[bias]), []).append(row)
    return [Swept(offset, tuple(own), points[own[0].point].bias) for offset, own in sorted(curves.items())]
