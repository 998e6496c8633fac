"""The results as files and as text: CSV with units in the headers, JSON, and lines for a terminal."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench.store.durable import replace_file

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from bench.analysis.results import Analysis, BackgroundRow, Estimate, PixelMap, ResponseRow, SCurve

__all__ = ["FORMAT", "save", "summary_lines", "to_json", "write_csv"]

FORMAT: Final = "evs-bench-analysis/1"

_KEY_COLUMNS: Final = ("waveform", "polarity", "baseline_lux", "nd_od", "pulse_width_s", "settings")
_RESPONSE_COLUMNS: Final = (
    "point",
    *_KEY_COLUMNS,
    "log_contrast_ln",
    "pulses",
    "pixels",
    "responses",
    "probability",
    "probability_low",
    "probability_high",
    "events_per_pulse",
    "answered_resets",
    "latency_median_s",
    "latency_iqr_s",
)
_CURVE_ESTIMATES: Final = (
    ("half", "ln"),
    ("intercept", "ln"),
    ("theta", "ln"),
    ("noise_rms", "ln"),
    ("mismatch", "ln"),
    ("corner_hz", "Hz"),
    ("floor", "1"),
    ("plateau", "1"),
)
_BACKGROUND_COLUMNS: Final = (
    "point",
    "polarity",
    "baseline_lux",
    "nd_od",
    "settings",
    "events",
    "pixel_seconds_s",
    "rate_hz",
    "rate_low_hz",
    "rate_high_hz",
    "note",
)


def write_csv(analysis: Analysis, path: Path) -> tuple[Path, ...]:
    """Write responses.csv, curves.csv and background.csv into the folder `path`, and return their paths.

    Units stand in the headers; a number that the data do not determine is an empty cell. Intervals are 90 %.
    """
    path.mkdir(parents=True, exist_ok=True)
    tables = {
        "responses.csv": (_RESPONSE_COLUMNS, [_response_cells(row) for row in analysis.responses]),
        "curves.csv": (_curve_columns(), [_curve_cells(curve) for curve in analysis.curves]),
        "background.csv": (_BACKGROUND_COLUMNS, [_background_cells(row) for row in analysis.background]),
    }
    for name, (header, rows) in tables.items():
        replace_file(path / name, _csv_bytes(header, rows))
    return tuple(path / name for name in tables)


def _csv_bytes(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([["" if _missing(cell) else cell for cell in row] for row in rows])
    return text.getvalue().encode()


def _missing(cell: Any) -> bool:
    return cell is None or (isinstance(cell, float) and not math.isfinite(cell))


def _key_cells(item: ResponseRow | SCurve) -> tuple[Any, ...]:
    return tuple(getattr(item.key, name) for name in _KEY_COLUMNS)


def _response_cells(row: ResponseRow) -> list[Any]:
    return [
        row.point,
        *_key_cells(row),
        row.log_contrast,
        row.pulses,
        row.pixels,
        row.responses,
        row.probability,
        row.low,
        row.high,
        row.events_per_pulse,
        row.answered_resets,
        row.latency_median_s,
        row.latency_iqr_s,
    ]


def _curve_columns() -> list[str]:
    columns = [*_KEY_COLUMNS, "contrasts"]
    for name, unit in _CURVE_ESTIMATES:
        tail = "_ln" if unit == "ln" else ""
        columns += [f"{name}{tail}", f"{name}_low{tail}", f"{name}_high{tail}"]
    return [*columns, "intercept_quantile", "answered_resets", "limited_by", "notes"]


def _curve_cells(curve: SCurve) -> list[Any]:
    cells: list[Any] = [*_key_cells(curve), curve.log_contrast.size]
    for name, _ in _CURVE_ESTIMATES:
        estimate: Estimate | None = getattr(curve, name)
        cells += [None] * 3 if estimate is None else [estimate.value, estimate.low, estimate.high]
    return [*cells, curve.quantile, curve.answered_resets, curve.limited_by, "; ".join(_notes(curve))]


def _notes(curve: SCurve) -> list[str]:
    notes = [f"{name}: {e.note}" for name, e in (("50 %", curve.half), ("100 %", curve.intercept)) if e.note]
    return [*notes, *curve.warnings]


def _background_cells(row: BackgroundRow) -> list[Any]:
    rate = row.rate
    return [
        row.point,
        row.polarity,
        row.baseline_lux,
        row.nd_od,
        row.settings,
        row.events,
        row.pixel_seconds,
        rate.value,
        rate.low,
        rate.high,
        rate.note,
    ]


def to_json(analysis: Analysis) -> dict[str, Any]:
    """Return the results as plain dictionaries and lists; a number that is not finite is None.

    Maps are left out but for their medians: they are large, and lie in pixel_maps.npz.
    """
    return {
        "format": FORMAT,
        "run": analysis.run_id,
        "title": analysis.title,
        "interval": 0.9,
        "curves": [_plain(asdict(curve)) for curve in analysis.curves],
        "background": [_plain(asdict(row)) for row in analysis.background],
        "responses": [_plain(_without(asdict(row), "per_pixel")) for row in analysis.responses],
        "pixel_maps": [_map_summary(item) for item in analysis.pixel_maps],
        "events": int(analysis.event_map.sum()),
        "damaged": list(analysis.damaged),
        "warnings": list(analysis.warnings),
    }


def _without(items: dict[str, Any], name: str) -> dict[str, Any]:
    return {key: value for key, value in items.items() if key != name}


def _plain(value: Any) -> Any:
    """Return `value` with arrays as lists, numpy numbers as Python's, and what is not finite as None."""
    import numpy as np

    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _map_summary(item: PixelMap) -> dict[str, Any]:
    import numpy as np

    known = item.half[np.isfinite(item.half)]
    spread = float(known.std(ddof=1)) if known.size > 1 else math.nan
    error = item.counting_error[np.isfinite(item.counting_error)]
    summary = {
        "key": asdict(item.key),
        "pixels": int(item.half.size),
        "known": int(known.size),
        "median_ln": float(np.median(known)) if known.size else math.nan,
        "spread_ln": spread,
        "median_counting_error_ln": float(np.median(error)) if error.size else math.nan,
    }
    return dict(_plain(summary))


def save(analysis: Analysis, run_folder: Path | str) -> Path:
    """Write the results into the folder `analysis` of a run, and return that folder.

    It then holds analysis.json, responses.csv, curves.csv, background.csv and pixel_maps.npz (each pixel's 50 %
    points, their errors, and the map of events). Each file is whole or absent: it is written beside its place, then
    moved there.
    """
    folder = Path(run_folder) / "analysis"
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(to_json(analysis), indent=1, ensure_ascii=False, allow_nan=False)
    replace_file(folder / "analysis.json", text.encode())
    write_csv(analysis, folder)
    replace_file(folder / "pixel_maps.npz", _maps_bytes(analysis))
    return folder


def _maps_bytes(analysis: Analysis) -> bytes:
    import numpy as np

    arrays: dict[str, Any] = {
        "event_map": analysis.event_map,
        "origin_xy": np.array(analysis.event_map_origin),
        "keys": np.array([json.dumps(asdict(item.key)) for item in analysis.pixel_maps], dtype=np.str_),
    }
    for i, item in enumerate(analysis.pixel_maps):
        arrays[f"half_ln_{i}"] = item.half
        arrays[f"counting_error_ln_{i}"] = item.counting_error
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def summary_lines(analysis: Analysis) -> list[str]:
    """Return the results as lines of text for a terminal: curves, background rates, warnings."""
    lines = [*_loss(analysis.damaged), f"{analysis.run_id}  {analysis.title}".rstrip()]
    if analysis.curves:
        lines += ["", "S-curves; contrasts in ln units, 90 % intervals", *_columns(_CURVE_TABLE, analysis.curves)]
        lines += _legend(analysis.curves)
    if analysis.background:
        lines += ["", "Background activity, 90 % intervals", *_columns(_BACKGROUND_TABLE, analysis.background)]
    warnings = [*analysis.warnings, *_curve_warnings(analysis.curves)]
    if warnings:
        lines += ["", "Warnings", *[f"  {text}" for text in warnings]]
    return lines


def _loss(damaged: Sequence[str]) -> list[str]:
    """Return the line that comes before all others when points were lost."""
    if not damaged:
        return []
    points = "1 point is" if len(damaged) == 1 else f"{len(damaged)} points are"
    return [f"DATA LOST: {points} damaged and left out; the warnings say which"]


def _legend(curves: Sequence[SCurve]) -> list[str]:
    lines = ["  100 %: where the curve has risen by 99 % of the way from floor to plateau"]
    if any(c.theta for c in curves):
        lines.append("  theta: fit of a noisy pixel; - where the data do not determine it")
    else:
        lines.append("  there is no theta: the data do not determine the fit of a noisy pixel")
    if any(c.limited_by for c in curves):
        lines.append("  (on), (off): a square wave shows the larger threshold; this curve is the other polarity's")
    return lines


def _curve_warnings(curves: Sequence[SCurve]) -> list[str]:
    """Return each warning once, with the curves that it concerns."""
    concerned: dict[str, list[str]] = {}
    for curve in curves:
        for text in curve.warnings:
            concerned.setdefault(text, []).append(f"{curve.key.polarity.upper()} {_lux(curve.key.baseline_lux)}")
    return [f"{_some(names)}: {text}" for text, names in concerned.items()]


def _some(names: Sequence[str], most: int = 4) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _lux(value: float) -> str:
    if value == 0.0:
        return "dark"
    return f"{value * 1e3:.3g} mlux" if value < 1.0 else f"{value:.3g} lux"


def _contrast(estimate: Estimate | None) -> str:
    if estimate is None or not math.isfinite(estimate.value):
        return "-"
    return f"{estimate.value:.3f} [{estimate.low:.3f}, {estimate.high:.3f}]"


def _share(value: float) -> str:
    return f"{value:.3f}" if math.isfinite(value) else "-"


def _rate(estimate: Estimate) -> str:
    if not math.isfinite(estimate.value):
        return "-"
    return f"{estimate.value:.3g} [{estimate.low:.2g}, {estimate.high:.2g}]"


def _limited(curve: SCurve) -> str:
    mark = f" ({curve.limited_by})" if curve.limited_by else ""
    return f"{curve.key.polarity.upper()}{mark}"


_CURVE_TABLE: Final[tuple[tuple[str, Callable[[Any], str]], ...]] = (
    ("curve", _limited),
    ("baseline", lambda c: _lux(c.key.baseline_lux)),
    ("pulse", lambda c: f"{c.key.pulse_width_s * 1e3:.3g} ms"),
    ("settings", lambda c: c.key.settings),
    ("50 %", lambda c: _contrast(c.half)),
    ("100 %", lambda c: _contrast(c.intercept)),
    ("theta", lambda c: _contrast(c.theta)),
    ("floor", lambda c: _share(c.floor.value)),
    ("plateau", lambda c: _share(c.plateau.value)),
    ("resets", lambda c: f"{c.answered_resets:.1%}" if math.isfinite(c.answered_resets) else "-"),
)
_BACKGROUND_TABLE: Final[tuple[tuple[str, Callable[[Any], str]], ...]] = (
    ("polarity", lambda b: b.polarity.upper()),
    ("baseline", lambda b: _lux(b.baseline_lux)),
    ("settings", lambda b: b.settings),
    ("events", lambda b: str(b.events)),
    ("rate per pixel (Hz)", lambda b: _rate(b.rate)),
)


def _columns(table: Sequence[tuple[str, Callable[[Any], str]]], items: Sequence[Any]) -> list[str]:
    """Return the items as aligned columns; a column that is empty throughout is left out."""
    columns = [[title, *[cell(item) for item in items]] for title, cell in table]
    columns = [column for column in columns if any(text not in ("", "-") for text in column[1:])]
    widths = [max(len(text) for text in column) for column in columns]
    rows = zip(*columns, strict=True)
    return ["  " + "  ".join(t.ljust(w) for t, w in zip(row, widths, strict=True)).rstrip() for row in rows]
