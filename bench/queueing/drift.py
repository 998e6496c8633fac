"""What the reference runs of a queue say of drift: the same quantities, run after run, with their errors."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final

from bench.store.durable import replace_file
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from bench.analysis.results import Analysis, BackgroundRow, Estimate, SCurve
    from bench.queueing.outcome import RunOutcome

__all__ = ["DRIFT_FILE", "Drift", "Reading", "drift_of", "drift_rows", "read_references", "write_drift"]

DRIFT_FILE: Final = "drift.csv"
#: Half width of a 90 % interval, in standard deviations of a normal distribution.
_HALF_WIDTH_90: Final = 1.6449


@dataclass(frozen=True, slots=True)
class Reading:
    """One quantity of one reference run; NaN where the run does not determine it."""

    run: int  #: number in the queue
    created: str  #: UTC, ISO 8601
    quantity: str
    unit: str
    value: float
    low: float  #: bounds of the 90 % interval
    high: float

    @property
    def error(self) -> float:
        """One standard deviation, from the interval."""
        return (self.high - self.low) / (2.0 * _HALF_WIDTH_90)

    def error_towards(self, value: float) -> float:
        """One standard deviation on the side of `value`: the interval of a small count is wider above than below."""
        side = self.high - self.value if value > self.value else self.value - self.low
        return side / _HALF_WIDTH_90


@dataclass(frozen=True, slots=True)
class Drift:
    """One quantity through the queue."""

    quantity: str
    unit: str
    first: Reading
    last: Reading
    runs: int  #: that determine it
    change: float  #: from the first to the last
    change_error: float  #: one standard deviation
    chi2_per_dof: float  #: of all readings around their mean; about 1 without drift, NaN from one reading


def read_references(outcomes: Sequence[RunOutcome]) -> tuple[list[Reading], list[str]]:
    """Return the readings of reference runs, in the order of the queue, and what cannot be read, a line each."""
    from bench.analysis import analyze
    from bench.store import Run

    readings: list[Reading] = []
    problems: list[str] = []
    for outcome in outcomes:
        try:
            run = Run.open(outcome.folder).without_damaged()
            created = str(run.header.everything.get("created", ""))
            readings += _readings(analyze(run, pixel_maps=False), outcome.run.number, created)
        except (ValueError, ArithmeticError, OSError, InputError) as error:
            problems.append(f"{outcome.folder}: no reference values: {' '.join(str(error).split())}")
    return readings, problems


def _readings(analysis: Analysis, run: int, created: str) -> Iterator[Reading]:
    for curve in analysis.curves:
        yield _reading(run, created, _curve_name(curve), curve.half)
    for row in analysis.background:
        yield _reading(run, created, _background_name(row), row.rate)


def _reading(run: int, created: str, quantity: str, estimate: Estimate) -> Reading:
    values = (float(estimate.value), float(estimate.low), float(estimate.high))
    return Reading(run, created, quantity, estimate.unit, *values)


def _curve_name(curve: SCurve) -> str:
    key = curve.key
    more = [f"{key.nd_od:g} OD" if key.nd_od else "", f"{1e3 * key.pulse_width_s:g} ms", key.settings]
    return f"{key.polarity.upper()} threshold at {key.baseline_lux:.4g} lux ({', '.join(filter(None, more))})"


def _background_name(row: BackgroundRow) -> str:
    more = [f"{row.nd_od:g} OD" if row.nd_od else "", row.settings]
    text = ", ".join(filter(None, more))
    return f"{row.polarity.upper()} background at {row.baseline_lux:.4g} lux" + (f" ({text})" if text else "")


def drift_of(readings: Sequence[Reading]) -> list[Drift]:
    """Return each quantity through the queue, in the order in which the first run gives them.

    Of several points of a run with the same name the first counts.
    """
    found: dict[str, dict[int, Reading]] = {}
    for reading in readings:
        if math.isfinite(reading.value):
            found.setdefault(reading.quantity, {}).setdefault(reading.run, reading)
    return [_drift(list(by_run.values())) for by_run in found.values()]


def _drift(readings: Sequence[Reading]) -> Drift:
    first, last = readings[0], readings[-1]
    change = last.value - first.value if len(readings) > 1 else math.nan
    error = math.hypot(first.error_towards(last.value), last.error_towards(first.value))
    error = error if len(readings) > 1 else math.nan
    return Drift(first.quantity, first.unit, first, last, len(readings), change, error, _chi2_per_dof(readings))


def _chi2_per_dof(readings: Sequence[Reading]) -> float:
    """Return the chi-square around the mean; equal runs count the same, so that few events do not draw the mean."""
    known = [r for r in readings if math.isfinite(r.error) and r.error > 0.0]
    if len(known) < 2:
        return math.nan
    mean = math.fsum(r.value for r in known) / len(known)
    errors = [r.error_towards(mean) or r.error for r in known]
    return math.fsum(((r.value - mean) / e) ** 2 for r, e in zip(known, errors, strict=True)) / (len(known) - 1)


def drift_rows(drifts: Sequence[Drift]) -> list[tuple[str, ...]]:
    """Return the drifts as rows of text: quantity, unit, runs, first, last, change with error, chi2 per dof."""
    return [
        (
            d.quantity,
            d.unit,
            str(d.runs),
            _with_error(d.first.value, d.first.error),
            _with_error(d.last.value, d.last.error),
            _with_error(d.change, d.change_error, sign="+"),
            f"{d.chi2_per_dof:.2f}" if math.isfinite(d.chi2_per_dof) else "",
        )
        for d in drifts
    ]


def _with_error(value: float, error: float, sign: str = "") -> str:
    """Return a value with its error to two digits, the value to the same place."""
    if not math.isfinite(value):
        return ""
    if not math.isfinite(error) or error <= 0.0:
        return f"{value:{sign}.4g}"
    places = min(max(1 - math.floor(math.log10(error)), 0), 9)
    return f"{value:{sign}.{places}f} +- {error:.{places}f}"


def write_drift(readings: Sequence[Reading], folder: Path) -> Path:
    """Write all readings into ``drift.csv`` in `folder`; a number that is not determined is an empty cell."""
    text = io.StringIO(newline="")
    names = ("run", "created", "quantity", "unit", "value", "low", "high")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    for reading in readings:
        cells = asdict(reading)
        writer.writerow([_cell(cells[name]) for name in names])
    path = folder / DRIFT_FILE
    replace_file(path, text.getvalue().encode())
    return path


def _cell(value: Any) -> Any:
    return "" if isinstance(value, float) and not math.isfinite(value) else value
