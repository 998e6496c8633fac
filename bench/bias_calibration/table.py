"""A quantity against the offsets of its bias, and whether it only rises or only falls as it must."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from bench.analysis.results import Estimate
from bench.characterize.normal import Z90
from bench.station.bias_map import QUANTITIES, BiasCurve

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["BiasTable", "Row", "make_table"]

_DIGITS: Final = 5  #: of a value in a station file
_LEAST_SD: Final = 1e-6  #: relative: no row outweighs all others


@dataclass(frozen=True, slots=True)
class Row:
    """The value at one offset, with its relative standard error."""

    offset: int
    value: float  #: above 0, in the unit of the quantity
    sd: float  #: relative
    note: str = ""

    def estimate(self, quantity: str) -> Estimate:
        """Return the value with its 90 % interval, which is symmetric in the logarithm."""
        factor = math.exp(Z90 * self.sd)
        return Estimate(self.value, self.value / factor, self.value * factor, QUANTITIES[quantity], self.note)


@dataclass(frozen=True, slots=True)
class BiasTable:
    """One quantity against the offset of one bias, as a run shows it."""

    quantity: str
    bias: str
    rows: tuple[Row, ...]  #: ascending; those that go into the bias map
    dropped: tuple[Row, ...]  #: rows out of order, by no more than their errors
    broken: tuple[Row, ...]  #: rows out of order by more than their errors: with any, there is no curve
    remarks: tuple[str, ...]

    @property
    def usable(self) -> bool:
        """Whether the rows make a curve."""
        return len(self.rows) > 1 and not self.broken

    def curve(self, scale: Literal["linear", "log"] = "log") -> BiasCurve:
        """Return the curve of a usable table."""
        return BiasCurve(
            quantity=self.quantity,
            bias=self.bias,
            scale=scale,
            offsets=tuple(row.offset for row in self.rows),
            values=tuple(row.value for row in self.rows),
            calibrated=True,
        )


def make_table(quantity: str, bias: str, rows: Sequence[Row], remarks: Sequence[str] = ()) -> BiasTable:
    """Return the table of a quantity, with the rows that break its order set apart.

    The largest weight of rows that only rise, or only fall, is kept; a row weighs the inverse of its variance, so
    that a vague row goes before an exact one. A row that is left out by no more than the 90 % interval of its
    distance to the rows kept is dropped; by more, the quantity does not follow this bias alone, and has no curve.

    Parameters
    ----------
    rows
        One for each offset, in any order.
    remarks
        What is known already, for people.
    """
    ordered = sorted((_rounded(row) for row in rows), key=lambda row: row.offset)
    kept = max((_heaviest(ordered, sign) for sign in (1.0, -1.0)), key=_weight)
    dropped: list[Row] = []
    broken: list[Row] = []
    said = list(remarks)
    for row in ordered:
        if row in kept:
            continue
        other = _contradicted(row, kept)
        distance = abs(math.log(row.value / other.value))
        allowed = Z90 * math.hypot(row.sd, other.sd)
        beyond = distance > allowed
        (broken if beyond else dropped).append(row)
        said.append(_remark(quantity, bias, row, other, beyond=beyond))
    if len(kept) == 1:
        said.append(f"{quantity}: one offset of {bias} with a value; a curve needs two")
    return BiasTable(quantity, bias, tuple(kept), tuple(dropped), tuple(broken), tuple(said))


def _rounded(row: Row) -> Row:
    return Row(row.offset, float(f"{row.value:.{_DIGITS}g}"), row.sd, row.note)


def _weight(rows: Sequence[Row]) -> float:
    return sum(1.0 / max(row.sd, _LEAST_SD) ** 2 for row in rows)


def _heaviest(rows: Sequence[Row], sign: float) -> list[Row]:
    """Return the rows of the largest weight whose values only rise (`sign` 1) or only fall (-1)."""
    best: list[list[Row]] = []
    for row in rows:
        before = [chain for chain in best if sign * (row.value - chain[-1].value) > 0.0]
        best.append([*max(before, key=_weight, default=[]), row])
    return max(best, key=_weight, default=[])


def _contradicted(row: Row, kept: Sequence[Row]) -> Row:
    """Return the kept row that `row` is farthest on the wrong side of."""
    rising = kept[-1].value > kept[0].value

    def wrong_by(other: Row) -> float:
        ahead = (other.offset > row.offset) == rising
        return math.log(row.value / other.value) * (1.0 if ahead else -1.0)

    return max(kept, key=wrong_by)


def _remark(quantity: str, bias: str, row: Row, other: Row, *, beyond: bool) -> str:
    unit = QUANTITIES[quantity]
    text = (
        f"{quantity} at {bias} {row.offset} is {row.value:.4g} {unit}, out of order with {other.value:.4g} {unit} at "
        f"{other.offset}"
    )
    if beyond:
        return (
            f"{text} by more than their errors: {quantity} has no curve; look at the S-curves of these offsets, "
            "or leave one of them out of the protocol"
        )
    return f"{text} by no more than their errors: the row is dropped"
