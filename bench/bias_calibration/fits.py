"""Thresholds and corners at each offset, from the fit of a noisy pixel."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from bench.analysis.curves import REARMED_ENOUGH
from bench.analysis.noisy_pixel import fit_theta, reason_against
from bench.bias_calibration.table import BiasTable, Row, make_table
from bench.characterize.levels import levels_of
from bench.characterize.normal import Z90, as_known
from bench.station.bias_map import QUANTITIES

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from bench.analysis.noisy_pixel import ThetaFit
    from bench.analysis.results import Estimate, ResponsePolarity
    from bench.bias_calibration.conditions import Swept
    from bench.store.data import PointData

__all__ = ["Curves", "corner_table", "threshold_table"]

_TAUS_OF_EDGE: Final = math.log(9.0)  #: from 10 % to 90 % of an exponential rise, time constants
_VAGUE: Final = (
    "the fit does not settle, or leaves it vague: the threshold is near the noise, or there are few answers"
)
#: An edge of the light this long, in time constants of the pixel, is as much of a latency as the pixel.
_LONG_EDGE: Final = 0.5


class Curves:
    """The curves at which thresholds were swept, for the fits that need the other polarity's threshold.

    Parameters
    ----------
    swept
        By polarity, at the offsets of its own bias.
    biases
        Bias of each polarity's threshold.
    points
        All points of the run, by number.
    """

    def __init__(
        self,
        swept: Mapping[ResponsePolarity, Sequence[Swept]],
        biases: Mapping[ResponsePolarity, str],
        points: Mapping[int, PointData],
    ) -> None:
        self._swept = swept
        self._biases = biases
        self._points = points
        self._found: dict[frozenset[int], ThetaFit | str] = {}
        self._alone: dict[tuple[ResponsePolarity, int], Estimate | None] = {}

    def fit(self, curve: Swept) -> ThetaFit | str:
        """Return the fit of a curve, or why there is none; a curve at rest belongs to several biases."""
        members = frozenset(row.point for row in curve.rows)
        if members not in self._found:
            self._found[members] = self._fit(curve)
        return self._found[members]

    def _fit(self, curve: Swept) -> ThetaFit | str:
        reason = reason_against(curve.rows)
        if reason is not None:
            return reason
        found = fit_theta(curve.rows, other=self._other(curve), armed_s=self._armed_s(curve))
        return _VAGUE if found is None else found

    def _armed_s(self, curve: Swept) -> float:
        own = [self._points[row.point] for row in curve.rows]
        return levels_of(curve.rows, own)[0].reset.armed_s

    def _other(self, curve: Swept) -> Estimate | None:
        """Return the other polarity's threshold at the biases of `curve`, from a curve of its own."""
        polarity: ResponsePolarity = "off" if curve.rows[0].key.polarity == "on" else "on"
        offset = curve.bias.get(self._biases[polarity])
        if offset is None:
            return None
        place = polarity, round(offset)
        if place not in self._alone:
            there = next((c for c in self._swept.get(polarity, ()) if c.offset == place[1]), None)
            self._alone[place] = None if there is None else self._theta_alone(there)
        return self._alone[place]

    def _theta_alone(self, curve: Swept) -> Estimate | None:
        if reason_against(curve.rows) is not None:
            return None
        found = fit_theta(curve.rows, armed_s=self._armed_s(curve))
        return None if found is None else found.theta


def threshold_table(
    quantity: str, bias: str, swept: Sequence[Swept], curves: Curves, tell: Callable[[str], None]
) -> BiasTable:
    """Return a threshold against the offset of its bias."""

    def row(curve: Swept, found: ThetaFit) -> Row:
        theta = as_known(found.theta)
        return Row(curve.offset, theta.value, theta.sd / theta.value, _poor(found))

    return _table(quantity, bias, swept, curves, row, tell)


def corner_table(
    quantity: str,
    bias: str,
    swept: Sequence[Swept],
    curves: Curves,
    light_edge_s: float | None,
    tell: Callable[[str], None],
) -> BiasTable:
    """Return the corner against the offset of its bias.

    A latency holds the edge of the light too. An edge that is not short against the time constant leaves no value;
    a short one widens the interval by the square of the ratio of the two time constants.

    Parameters
    ----------
    light_edge_s
        10 % to 90 % of an edge of the light; None where it is not known.
    """

    def row(curve: Swept, found: ThetaFit) -> Row | str:
        corner = found.corner_hz
        tau_s = 1.0 / (2.0 * math.pi * corner.value)
        sd = math.log(corner.high / corner.low) / (2.0 * Z90)
        edge_s = light_edge_s or 0.0
        if edge_s > _LONG_EDGE * tau_s:
            return (
                f"the light's edge of {1e3 * edge_s:.3g} ms is not short against the pixel's time constant, which "
                f"with it looks like {1e3 * tau_s:.3g} ms"
            )
        return Row(curve.offset, corner.value, math.hypot(sd, (edge_s / _TAUS_OF_EDGE / tau_s) ** 2), _poor(found))

    table = _table(quantity, bias, swept, curves, row, tell)
    if light_edge_s is not None or not table.rows:
        return table
    told = (*table.remarks, f"{quantity}: the light's edges are taken as sharp; name the station that has the light")
    return BiasTable(table.quantity, table.bias, table.rows, table.dropped, table.broken, told)


def _table(
    quantity: str,
    bias: str,
    swept: Sequence[Swept],
    curves: Curves,
    make: Callable[[Swept, ThetaFit], Row | str],
    tell: Callable[[str], None],
) -> BiasTable:
    rows, remarks = [], []
    for curve in swept:
        tell(f"{quantity}: {bias} at {curve.offset}")
        found = curves.fit(curve)
        made = found if isinstance(found, str) else make(curve, found)
        if isinstance(made, str):
            remarks.append(f"{quantity} at {bias} {curve.offset}: no value in {QUANTITIES[quantity]}: {made}")
            continue
        rows.append(made)
        share = min(row.answered_resets for row in curve.rows)
        if share < REARMED_ENOUGH:
            remarks.append(f"{quantity} at {bias} {curve.offset}: only {share:.0%} of the resets were answered")
    if not swept:
        remarks.append(f"{quantity}: the run has no reset and test pulses at several offsets of {bias}")
    return make_table(quantity, bias, rows, remarks)


def _poor(found: ThetaFit) -> str:
    return "poor fit, interval widened" if "poor fit" in found.note else ""
