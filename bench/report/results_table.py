"""The tables of the page, as text: key results, curves, responses, background, pixel maps, warnings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bench.report.figures.pixel_maps import spread_of
from bench.report.wording import (
    MISSING,
    count,
    decimals_for,
    duration_label,
    fixed,
    lux_label,
    polarity_label,
    waveform_label,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from bench.analysis.results import Analysis, BackgroundRow, CurveKey, Estimate, PixelMap, ResponseRow, SCurve

__all__ = [
    "Cell",
    "Table",
    "Warned",
    "background_table",
    "curve_details",
    "headline",
    "key_results",
    "pixel_table",
    "response_table",
    "warned",
]


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell: a value, its interval below it, and a remark."""

    text: str
    interval: str = ""
    note: str = ""
    mark: str = ""  #: letter of the note, below the table
    polarity: str = ""  #: `on` or `off`: drawn with the sign of that polarity


@dataclass(frozen=True, slots=True)
class Table:
    """Column heads with their units, and rows of cells."""

    heads: tuple[tuple[str, str], ...]  #: name, unit
    rows: tuple[tuple[Cell, ...], ...]
    left: int  #: so many columns at the left hold names, the others numbers
    notes: tuple[tuple[str, str], ...] = ()  #: letter and text


@dataclass(frozen=True, slots=True)
class Warned:
    """A warning, and the curves that it is about (empty: the whole run)."""

    text: str
    about: tuple[str, ...]


def _table(heads: Sequence[tuple[str, str]], rows: Sequence[tuple[Cell, ...]], left: int) -> Table:
    """Return a table whose remarks stand below it, each once, with a letter in the cells."""
    letters: dict[str, str] = {}
    for cell in (cell for row in rows for cell in row if cell.note):
        letters.setdefault(cell.note, _letter(len(letters)))
    marked = tuple(tuple(replace(cell, mark=letters.get(cell.note, "")) for cell in row) for row in rows)
    return Table(tuple(heads), marked, left, tuple((letter, note) for note, letter in letters.items()))


def _letter(number: int) -> str:
    """Return a, b, ... z, aa, ab and so on."""
    before, last = divmod(number, 26)
    return (_letter(before - 1) if before else "") + chr(ord("a") + last)


class _Naming:
    """Columns that tell the curves of a run apart; what is the same in all of them is left out."""

    def __init__(self, keys: Iterable[CurveKey]) -> None:
        known = list(keys)
        columns: list[tuple[str, Callable[[CurveKey], str]]] = [
            ("waveform", lambda key: waveform_label(key.waveform)),
            ("ND filter", lambda key: _filter_label(key.nd_od)),
            ("pulse", lambda key: duration_label(key.pulse_width_s)),
            ("settings", lambda key: key.settings),
        ]
        self.columns = [(name, of) for name, of in columns if len({of(key) for key in known}) > 1]

    def heads(self) -> tuple[tuple[str, str], ...]:
        return (("polarity", ""), ("light on chip", ""), *((name, "") for name, _ in self.columns))

    def cells(self, key: CurveKey) -> tuple[Cell, ...]:
        first = Cell(polarity_label(key.polarity), polarity=key.polarity)
        return (first, Cell(lux_label(key.baseline_lux)), *(Cell(of(key)) for _, of in self.columns))

    def label(self, key: CurveKey) -> str:
        rest = [text for _, of in self.columns if (text := of(key)) not in ("", "none")]
        return ", ".join([f"{polarity_label(key.polarity)} {lux_label(key.baseline_lux)}", *rest])


def _filter_label(nd_od: float) -> str:
    return f"OD {nd_od:g}" if nd_od else "none"


def _order(key: CurveKey) -> tuple[object, ...]:
    return (key.waveform, key.settings, key.pulse_width_s, key.polarity != "on", key.baseline_lux, key.nd_od)


def _column(estimates: Sequence[Estimate | None], scale: float = 1.0) -> list[Cell]:
    """Return one column of numbers with their intervals, all with the decimals that the typical one deserves."""
    known = [e for e in estimates if e is not None and np.isfinite(e.value)]
    wanted = sorted(decimals_for(e.low * scale, e.high * scale, e.value * scale) for e in known)
    decimals = wanted[len(wanted) // 2] if wanted else 3
    return [_estimate(estimate, scale, decimals) for estimate in estimates]


def _estimate(estimate: Estimate | None, scale: float, decimals: int) -> Cell:
    if estimate is None:
        return Cell(MISSING)
    low, high = fixed(estimate.low * scale, decimals), fixed(estimate.high * scale, decimals)
    interval = "" if low == high == MISSING else f"{low} to {high}"
    return Cell(fixed(estimate.value * scale, decimals), interval, estimate.note)


def _percent(share: float) -> Cell:
    return Cell(f"{100.0 * share:.1f}" if np.isfinite(share) else MISSING)


def key_results(curves: Sequence[SCurve]) -> Table | None:
    """Return the thresholds that were read off the S-curves, or None without curves."""
    ordered = sorted(curves, key=lambda curve: _order(curve.key))
    columns = [
        ("50 % point", "ln", _column([curve.half for curve in ordered])),
        ("intercept", "ln", _column([c.intercept for c in ordered])),
    ]
    if any(curve.theta is not None for curve in ordered):
        columns.append(("fitted threshold", "ln", _column([c.theta for c in ordered])))
        columns.append(("noise rms", "ln", _column([c.noise_rms for c in ordered])))
    return _curve_table(ordered, columns)


def curve_details(curves: Sequence[SCurve]) -> Table | None:
    """Return floors, plateaus, the rest of the fit and answered resets of the S-curves, or None without curves."""
    ordered = sorted(curves, key=lambda curve: _order(curve.key))
    columns = [
        ("contrasts", "", [Cell(f"{curve.log_contrast.size}") for curve in ordered]),
        ("floor", "%", _column([curve.floor for curve in ordered], 100.0)),
        ("plateau", "%", _column([curve.plateau for curve in ordered], 100.0)),
    ]
    if any(curve.mismatch is not None for curve in ordered):
        columns.append(("mismatch", "ln", _column([curve.mismatch for curve in ordered])))
    if any(curve.corner_hz is not None for curve in ordered):
        columns.append(("corner", "Hz", _column([curve.corner_hz for curve in ordered])))
    if any(np.isfinite(curve.answered_resets) for curve in ordered):
        columns.append(("resets answered", "%", [_percent(curve.answered_resets) for curve in ordered]))
    return _curve_table(ordered, columns)


def _curve_table(curves: Sequence[SCurve], columns: Sequence[tuple[str, str, list[Cell]]]) -> Table | None:
    """Return a table with one row for each curve, from columns of name, unit and cells."""
    if not curves:
        return None
    naming = _Naming(curve.key for curve in curves)
    heads = (*naming.heads(), *((name, unit) for name, unit, _ in columns))
    rows = []
    for row, curve in enumerate(curves):
        first, *names = naming.cells(curve.key)
        rows.append((_limited(first, curve), *names, *(cells[row] for _, _, cells in columns)))
    return _table(heads, rows, len(naming.heads()))


def _limited(cell: Cell, curve: SCurve) -> Cell:
    """Return the name of a curve with a remark where a square wave shows the other, less sensitive threshold."""
    if curve.limited_by is None:
        return cell
    return replace(cell, note=f"limited by the {polarity_label(curve.limited_by)} threshold, the less sensitive one")


def response_table(rows: Sequence[ResponseRow]) -> Table | None:
    """Return the response table, one row for each point, polarity and contrast, or None without responses."""
    if not rows:
        return None
    naming = _Naming(row.key for row in rows)
    reset = any(np.isfinite(row.answered_resets) for row in rows)
    heads = [
        ("point", ""),
        *naming.heads(),
        ("log contrast", "ln"),
        ("pulses", ""),
        ("pixels", ""),
        ("responses", ""),
        ("probability", ""),
        ("events per pulse", ""),
        ("median latency", "ms"),
    ]
    heads += [("resets answered", "%")] if reset else []
    body = []
    for row in rows:
        cells = [
            Cell(f"{row.point}"), *naming.cells(row.key), Cell(fixed(row.log_contrast, 4)), Cell(f"{row.pulses}"),
            Cell(f"{row.pixels}"), Cell(f"{row.responses}"),
            Cell(fixed(row.probability, 4), f"{fixed(row.low, 4)} to {fixed(row.high, 4)}"),
            Cell(fixed(row.events_per_pulse, 3)), Cell(fixed(1e3 * row.latency_median_s, 3)),
        ]  # fmt: skip
        body.append(tuple([*cells, _percent(row.answered_resets)] if reset else cells))
    return _table(heads, body, 1 + len(naming.heads()))


def background_table(rows: Sequence[BackgroundRow]) -> Table | None:
    """Return the background rates, one row for each constant point, or None without any."""
    if not rows:
        return None
    points: dict[int, list[BackgroundRow]] = {}
    for row in rows:
        points.setdefault(row.point, []).append(row)
    filters = len({row.nd_od for row in rows}) > 1
    settings = len({row.settings for row in rows}) > 1
    heads = [("point", ""), ("light on chip", "")]
    heads += [("ND filter", "")] if filters else []
    heads += [("settings", "")] if settings else []
    body = []
    for point, members in points.items():
        first = members[0]
        cells = [Cell(f"{point}"), Cell(lux_label(first.baseline_lux))]
        cells += [Cell(_filter_label(first.nd_od))] if filters else []
        cells += [Cell(first.settings)] if settings else []
        body.append((*cells, Cell(f"{first.pixel_seconds:.4g}"), *_rates(members)))
    rates = (("observed", "pixel s"), ("ON events", ""), ("ON rate", "Hz"), ("OFF events", ""), ("OFF rate", "Hz"))
    return _table((*heads, *rates), body, len(heads))


def _rates(members: Sequence[BackgroundRow]) -> Iterator[Cell]:
    """Yield number of events and rate, ON then OFF, of one point."""
    for polarity in ("on", "off"):
        row = next((row for row in members if row.polarity == polarity), None)
        yield Cell(f"{row.events}" if row else MISSING)
        yield _rate(row) if row else Cell(MISSING)


def _rate(row: BackgroundRow) -> Cell:
    """Return the rate with three significant digits, or its upper limit where no event was seen."""
    rate = row.rate
    if row.events == 0:
        return Cell(f"< {rate.high:.3g}") if np.isfinite(rate.high) else Cell(MISSING, "", rate.note)
    return Cell(f"{rate.value:.3g}", f"{rate.low:.3g} to {rate.high:.3g}", rate.note)


def pixel_table(maps: Sequence[PixelMap]) -> Table | None:
    """Return how the pixels of each map are distributed, or None without maps."""
    if not maps:
        return None
    naming = _Naming(pixel_map.key for pixel_map in maps)
    heads = (*naming.heads(), ("pixels with a threshold", ""), ("median", "ln"), ("spread", "ln"),
             ("from counting", "ln"), ("of the pixels", "ln"))  # fmt: skip
    body = []
    for pixel_map in sorted(maps, key=lambda m: _order(m.key)):
        spread = spread_of(pixel_map)
        numbers = (Cell(fixed(v, 4)) for v in (spread.median, spread.total, spread.counting, spread.own))
        body.append((*naming.cells(pixel_map.key), Cell(f"{spread.pixels} of {spread.of}"), *numbers))
    return _table(heads, body, len(naming.heads()))


def warned(analysis: Analysis) -> tuple[Warned, ...]:
    """Return the warnings of the run, then those of its curves; the same words about several curves stand once."""
    naming = _Naming(curve.key for curve in analysis.curves)
    by_text: dict[str, list[str]] = {text: [] for text in analysis.warnings}
    for curve in sorted(analysis.curves, key=lambda c: _order(c.key)):
        for text in curve.warnings:
            by_text.setdefault(text, []).append(naming.label(curve.key))
    everything = len({naming.label(curve.key) for curve in analysis.curves})
    return tuple(_warned(text, tuple(dict.fromkeys(about)), everything) for text, about in by_text.items())


def _warned(text: str, about: tuple[str, ...], everything: int) -> Warned:
    return Warned(text, ("all S-curves",) if 1 < len(about) == everything else about)


def headline(analysis: Analysis, points: int) -> str:
    """Return one sentence on what the report holds."""
    parts = [count(points, "point")]
    if analysis.curves:
        parts.append(count(len(analysis.curves), "S-curve"))
    if analysis.background:
        parts.append(count(len(analysis.background), "background rate"))
    return ", ".join(parts)
