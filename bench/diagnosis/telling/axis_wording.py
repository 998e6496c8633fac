"""Residuals along every axis, as a person reads them at a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from bench.diagnosis.telling.by_axis import AXES, told_bins
from bench.diagnosis.telling.wording import on_axis, significant

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from bench.diagnosis.telling.by_axis import Bin

__all__ = ["axis_lines", "axis_title", "bin_label", "flattening_lines"]

_TITLES: Final = {
    "anywhere": "all",
    "illuminance": "illuminance on chip",
    "contrast": "log contrast",
    "pulse width": "length of the test pulse",
    "events at once": "events of all pixels in one pulse",
    "polarity": "polarity",
    "ND filter": "density of the ND filter",
    "order": "points in their order",
    "halves": "time in a recording",
}
_POLARITIES: Final = ("ON", "OFF", "both")
#: A mean square is told as too large where it is so many standard errors above one.
_NOTABLE: Final = 4.0
_RESPONSE: Final = "response"


def axis_title(axis: str) -> str:
    """Return what an axis is called."""
    return _TITLES.get(axis, axis)


def bin_label(one: Bin) -> str:
    """Return the value, or the range of values, of a bin."""
    if one.axis == "anywhere":
        return "everywhere"
    if one.axis == "halves":
        return "second half less first"
    if one.axis == "polarity":
        return _POLARITIES[int(one.low)]
    if one.axis == "order":
        return f"point {one.low:.0f}" if one.low == one.high else f"points {one.low:.0f} to {one.high:.0f}"
    if one.axis in ("contrast", "events at once"):
        low, high = f"{one.low:.3g}", f"{one.high:.3g}"
        return low if low == high else f"{low} to {high}"
    low, high = on_axis(one.axis, one.low), on_axis(one.axis, one.high)
    return low if low == high else f"{low} to {high}"


def axis_lines(bins: Sequence[Bin]) -> Iterator[str]:
    """Yield a table for the views, and one for each axis that has several values.

    An asterisk marks what is further off than chance takes a true model.
    """
    yield from _table("view", [(b.view.replace("_", " "), b, b) for b in told_bins(bins, "anywhere")], "mean z")
    responses = {(b.axis, b.low): b for b in bins if b.view == _RESPONSE}
    for axis in AXES[1:]:
        rows = [(bin_label(b), b, responses.get((b.axis, b.low))) for b in told_bins(bins, axis)]
        if rows:
            yield from _table(axis_title(axis), rows, "mean z of responses")


def flattening_lines(before: Sequence[Bin], after: Sequence[Bin]) -> Iterator[str]:
    """Yield how far the same statistics are off two models, side by side: in each view, and along each axis."""
    pairs = [
        (was, now) for axis in AXES for was, now in zip(told_bins(before, axis), told_bins(after, axis), strict=True)
    ]
    title = "mean square residual"
    width = max(len(title), *(len(_of_either(now)) for _, now in pairs)) if pairs else len(title)
    yield f"{title:{width}}     before      after   by chance"
    for was, now in pairs:
        squares = f"{significant(was.square):>9}  {significant(now.square):>9}"
        yield f"{_of_either(now):{width}}  {squares}   1.00 +/- {now.square_sd:.2f}"


def _of_either(one: Bin) -> str:
    """Return the name of a view, or a value of an axis with the name of that."""
    if one.axis == "anywhere":
        return one.view.replace("_", " ")
    return bin_label(one) if one.axis in ("order", "halves") else f"{one.axis} {bin_label(one)}"


def _table(title: str, rows: Sequence[tuple[str, Bin, Bin | None]], mean: str) -> Iterator[str]:
    width = max(len(title), *(len(label) for label, _, _ in rows)) if rows else len(title)
    yield f"{title:{width}}  statistics  mean square z   by chance         {mean}"
    for label, all_of, one in rows:
        far = "*" if all_of.square > 1.0 + _NOTABLE * all_of.square_sd else " "
        line = f"{label:{width}}  {all_of.count:10}  {all_of.square:13.2f}{far}  1.00 +/- {all_of.square_sd:4.2f}"
        yield line + (f"     {one.mean:+7.2f} +/- {one.mean_sd:.2f}" if one is not None else "")
    yield ""
