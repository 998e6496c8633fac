"""Which thresholds are quiet enough: background rates against the offsets of both, and the pair for a rate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench.analysis.results import Estimate

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    import numpy.typing as npt

    from bench.analysis.results import BackgroundRow
    from bench.station.bias_map import BiasCurve
    from bench.store.data import PointData

    Floats = npt.NDArray[np.float64]

__all__ = ["NoiseRate", "Tuning", "noise_rates", "tune"]


@dataclass(frozen=True, slots=True)
class NoiseRate:
    """Background events, ON and OFF together, at one pair of offsets."""

    on_offset: int
    off_offset: int
    rate: Estimate  #: Hz, of a pixel


@dataclass(frozen=True, slots=True)
class Tuning:
    """The most sensitive pair of equal thresholds that is quiet enough."""

    target_hz: float
    on_offset: int
    off_offset: int
    theta_on: float  #: ln
    theta_off: float  #: ln
    rate: Estimate  #: Hz, interpolated between the pairs that were measured
    note: str = ""


def noise_rates(
    background: Sequence[BackgroundRow], points: Sequence[PointData], on_bias: str, off_bias: str
) -> tuple[NoiseRate, ...]:
    """Return the rates at each pair of offsets, of its longest recording.

    Parameters
    ----------
    background
        Rows of the whole run.
    points
        Constant points at which nothing but the two biases differs.
    """
    rows: dict[int, list[BackgroundRow]] = {}
    for row in background:
        rows.setdefault(row.point, []).append(row)
    longest: dict[tuple[int, int], list[BackgroundRow]] = {}
    for point in points:
        pair = round(point.bias[on_bias]), round(point.bias[off_bias])
        own = rows.get(point.index, [])
        if own and own[0].pixel_seconds > (longest[pair][0].pixel_seconds if pair in longest else 0.0):
            longest[pair] = own
    return tuple(NoiseRate(*pair, _sum([row.rate for row in own])) for pair, own in sorted(longest.items()))


def _sum(rates: Sequence[Estimate]) -> Estimate:
    """Return the sum of independent rates; the halves of their intervals add in quadrature."""
    total = sum(r.value for r in rates)
    low = math.hypot(*(r.value - r.low for r in rates))
    high = math.hypot(*(r.high - r.value for r in rates))
    return Estimate(total, max(total - low, 0.0), total + high, "Hz", "" if total else "no events: an upper limit")


def tune(
    target_hz: float, rates: Sequence[NoiseRate], on: BiasCurve, off: BiasCurve
) -> Tuning | str:  # fmt: skip
    """Return the pair of offsets with the lowest equal thresholds at which noise stays within a rate, or why none.

    The logarithm of the rate is close to linear in the squares of the thresholds, as crossings of Gaussian noise are
    (S. O. Rice, "Mathematical analysis of random noise", Bell Syst. Tech. J. 24, 1945), and is interpolated so. All
    higher thresholds along the way must be as quiet.

    Parameters
    ----------
    target_hz
        Events per pixel and second, ON and OFF together, at the most.
    rates
        At each pair of several offsets of both biases.
    on, off
        Thresholds against offsets, as calibrated.
    """
    grid = _Grid.of(rates, on, off)
    if isinstance(grid, str):
        return grid
    candidates = _balanced(grid, on, off)
    if not candidates:
        return "no pair of offsets with a measured rate has equal thresholds"
    found = [(pair, grid.rate(on.value_at(pair[0]), off.value_at(pair[1]))) for pair in candidates]
    quiet = len(found)
    while quiet and found[quiet - 1][1].value <= target_hz:
        quiet -= 1
    if quiet == len(found):
        pair, rate = found[-1]
        return (
            f"{target_hz:g} Hz is not reached: at the highest equal thresholds, {on.bias} {pair[0]} and {off.bias} "
            f"{pair[1]}, noise makes {rate.value:.3g} Hz; measure background rates at higher offsets"
        )
    (on_offset, off_offset), rate = found[quiet]
    note = "" if quiet else "these are the lowest that were measured; lower ones may be quiet enough too"
    return Tuning(target_hz, on_offset, off_offset, on.value_at(on_offset), off.value_at(off_offset), rate, note)


def _balanced(grid: _Grid, on: BiasCurve, off: BiasCurve) -> list[tuple[int, int]]:
    """Return pairs of offsets with thresholds as equal as whole offsets allow, from the lowest on."""
    low = max(float(grid.theta_on[0]), float(grid.theta_off[0]))
    high = min(float(grid.theta_on[-1]), float(grid.theta_off[-1]))
    thetas = {
        curve.value_at(offset)
        for curve, ends in ((on, grid.on_ends), (off, grid.off_ends))
        for offset in range(ends[0], ends[1] + 1)
    }
    pairs = [(on.offset_for(t), off.offset_for(t)) for t in sorted(thetas) if low <= t <= high]
    return list(dict.fromkeys(pairs))


@dataclass(frozen=True, slots=True)
class _Grid:
    """Rates on a rectangle of thresholds, both ascending."""

    theta_on: Floats  #: (m,)
    theta_off: Floats  #: (n,)
    on_ends: tuple[int, int]  #: lowest and highest offset
    off_ends: tuple[int, int]
    log_rate: Floats  #: (3, m, n) of the rate and of both ends of its interval

    @classmethod
    def of(cls, rates: Sequence[NoiseRate], on: BiasCurve, off: BiasCurve) -> _Grid | str:
        by_pair = {(r.on_offset, r.off_offset): r.rate for r in rates}
        ons = _known({pair[0] for pair in by_pair}, on)
        offs = _known({pair[1] for pair in by_pair}, off)
        if len(ons) < 2 or len(offs) < 2:
            return (
                "background rates at two or more offsets of both thresholds are needed, with known thresholds there"
            )
        if any((a, b) not in by_pair for a in ons for b in offs):
            return "background rates are needed at all combinations of the offsets of both thresholds"
        logs = np.array([[_logs(by_pair[a, b]) for b in offs] for a in ons])
        return cls(
            np.array([on.value_at(a) for a in ons]),
            np.array([off.value_at(b) for b in offs]),
            (min(ons), max(ons)),
            (min(offs), max(offs)),
            np.moveaxis(logs, 2, 0),
        )

    def rate(self, theta_on: float, theta_off: float) -> Estimate:
        """Return the rate between the pairs that were measured, Hz."""
        value, low, high = (
            math.exp(_bilinear(layer, self.theta_on**2, self.theta_off**2, theta_on**2, theta_off**2))
            for layer in self.log_rate
        )
        return Estimate(value, low, high, "Hz")


def _known(offsets: Collection[int], curve: BiasCurve) -> list[int]:
    """Return the offsets at which the threshold is known, by ascending threshold."""
    inside = [o for o in offsets if curve.offsets[0] <= o <= curve.offsets[-1]]
    return sorted(inside, key=curve.value_at)


def _logs(rate: Estimate) -> tuple[float, float, float]:
    """Return the logarithms of a rate and its interval; where no events were seen, the upper limit stands for all."""
    high = math.log(rate.high)
    return (
        math.log(rate.value) if rate.value > 0.0 else high,
        math.log(rate.low) if rate.low > 0.0 else math.log(rate.value) if rate.value > 0.0 else high,
        high,
    )


def _bilinear(values: Floats, x: Floats, y: Floats, at_x: float, at_y: float) -> float:
    along_y = [float(np.interp(at_y, y, row)) for row in values]
    return float(np.interp(at_x, x, along_y))
