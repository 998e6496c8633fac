"""Curves that were measured elsewhere, as CSV: read off a figure of a paper, say.

One line for each point, under the header ``log_contrast,probability,baseline_lux``; ``polarity`` (on), ``nd_od`` (0)
and ``probability_sd`` may stand beside them. Lines that begin with # are comments. There are no counts, so that the
error of a reading is that of the points: how well a share could be read off, given with each point or for all.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.results import CurveKey, Estimate, SCurve
from bench.analysis.scurve import INTERCEPT_LEVEL, rising_means
from bench.analysis.sigmoid import NORMAL, fit_counts, floor_and_plateau
from bench.characterize.families import CurveFamily
from bench.characterize.normal import Z90
from bench.photometry.csv_tables import plain_number
from protocols.errors import InputError, Problem
from protocols.files import read_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    import numpy.typing as npt

    from bench.analysis.results import ResponsePolarity

    Floats = npt.NDArray[np.float64]

__all__ = ["DigitisedPoint", "digitised_families", "read_points"]

_MUST: Final = ("log_contrast", "probability", "baseline_lux")
_MAY: Final = ("polarity", "nd_od", "probability_sd")
_FEWEST: Final = 4  # points of a curve
_SAMPLES: Final = 400
_SEED: Final = 20240901
_LEAST: Final = 1e-3  # a share is kept this far from 0 and 1 where it is disturbed


@dataclass(frozen=True, slots=True)
class DigitisedPoint:
    """One point of a curve."""

    log_contrast: float  #: ln(E_max / E_min)
    probability: float
    baseline_lux: float
    polarity: ResponsePolarity
    nd_od: float
    sd: float  #: standard error of the probability


def read_points(path: Path, probability_sd: float | None = None) -> list[DigitisedPoint]:
    """Return the points in the CSV file `path`.

    Parameters
    ----------
    probability_sd
        Standard error of a share that does not tell its own; None where each must.

    Raises
    ------
    InputError
        With the line of everything that is wrong.
    """
    try:
        return _parse(read_text(path), str(path), probability_sd)
    except csv.Error as error:
        raise InputError(f"{path}: {error}") from None


def _parse(text: str, source: str, probability_sd: float | None) -> list[DigitisedPoint]:
    # Comments become empty lines, so that lines keep their numbers.
    table = csv.reader("" if line.startswith("#") else line for line in text.splitlines())
    header = [name.strip() for name in next((cells for cells in table if cells), [])]
    missing = [name for name in _MUST if name not in header]
    unknown = [name for name in header if name not in (*_MUST, *_MAY)]
    if missing or unknown or len(set(header)) < len(header):
        what = f"lacks {', '.join(missing)}" if missing else f"has {', '.join(unknown) or 'a column twice'}"
        expected = f"expected {', '.join(_MUST)}, and perhaps {', '.join(_MAY)}"
        raise InputError(Problem(f"the header {what}; {expected}", source, max(table.line_num, 1)))
    found, problems = [], []
    for cells in table:
        if not any(cell.strip() for cell in cells):
            continue
        try:
            found.append(_point(dict(zip(header, cells, strict=True)), probability_sd))
        except ValueError as error:
            wrong = "as many cells as the header has are expected" if "zip()" in str(error) else str(error)
            problems.append(Problem(wrong, source, table.line_num))
    if problems:
        raise InputError(*problems)
    if not found:
        raise InputError(Problem("no points; expected one in each line below the header", source, 1))
    return found


def _point(cells: dict[str, str], probability_sd: float | None) -> DigitisedPoint:
    sd = cells.get("probability_sd", "").strip()
    if not sd and probability_sd is None:
        raise ValueError(
            "no standard error of the probability; expected a column probability_sd, or one for all with "
            "--probability-sd"
        )
    polarity = cells.get("polarity", "").strip().lower() or "on"
    if polarity not in ("on", "off"):
        raise ValueError(f"polarity is {polarity!r}; expected on or off")
    return DigitisedPoint(
        log_contrast=_number(cells, "log_contrast", 0.0, 20.0),
        probability=_number(cells, "probability", 0.0, 1.0),
        baseline_lux=_number(cells, "baseline_lux", 1e-9, 1e9),
        polarity="on" if polarity == "on" else "off",
        nd_od=_number(cells, "nd_od", 0.0, 20.0) if cells.get("nd_od", "").strip() else 0.0,
        sd=_number(cells, "probability_sd", 1e-6, 1.0) if sd else float(probability_sd or 0.0),
    )


def _number(cells: dict[str, str], name: str, low: float, high: float) -> float:
    text = cells[name].strip()
    value = plain_number(text)
    if value is None or not low <= value <= high:
        raise ValueError(f"{name} is {text!r}; expected a number from {low:g} to {high:g}")
    return value


def digitised_families(points: Iterable[DigitisedPoint]) -> list[CurveFamily]:
    """Return the curves of the points as families, one for each polarity."""
    groups: dict[ResponsePolarity, dict[tuple[float, float], list[DigitisedPoint]]] = {}
    for point in points:
        groups.setdefault(point.polarity, {}).setdefault((point.baseline_lux, point.nd_od), []).append(point)
    found = []
    for polarity, levels in groups.items():
        curves = [_curve(own) for _, own in sorted(levels.items(), key=lambda item: (item[0][0], -item[0][1]))]
        found.append(CurveFamily(polarity, "reset_test", math.nan, "read from a file", tuple(curves), ()))
    return found


def _curve(points: Sequence[DigitisedPoint]) -> SCurve:
    points = sorted(points, key=lambda p: p.log_contrast)
    x, p, sd = (np.array([getattr(q, name) for q in points]) for name in ("log_contrast", "probability", "sd"))
    first = points[0]
    key = CurveKey("reset_test", first.polarity, first.baseline_lux, first.nd_od, math.nan, "read from a file")
    return _fitted(key, x, p, sd)


def _fitted(key: CurveKey, x: Floats, p: Floats, sd: Floats) -> SCurve:
    """Return the curve with its 50 % point and intercept: a Gaussian with free floor and plateau."""
    weight = 1.0 / sd**2
    rising = rising_means(p, weight)
    low, high = float(rising[0]), float(rising[-1])
    reason = ""
    if x.size < _FEWEST:
        reason = f"{x.size} points; at least {_FEWEST} are needed"
    elif not high - low > 0.5 or np.unique(x).size < x.size:
        reason = "the points do not rise from a floor to a plateau, one for each contrast"
    nan = np.zeros(0)
    if reason:
        none = Estimate(math.nan, math.nan, math.nan, "ln", reason)
        return _scurve(key, x, p, sd, (none, none, none, none), nan, nan)
    relative = (rising - low) / (high - low) + 1e-9 * np.arange(x.size)
    x16, x50, x84 = np.interp([0.16, 0.5, 0.84], relative, x)
    start = np.array(
        [x50, math.log(max(0.5 * (x84 - x16), 1e-3)), math.asin(math.sqrt(max(low, 1e-4))), _angle(low, high)]
    )
    best = fit_counts(NORMAL, start[None], x, p[None], weight[None])
    drawn = np.random.default_rng(_SEED).normal(p, sd, (_SAMPLES, x.size)).clip(_LEAST, 1.0 - _LEAST)
    samples = fit_counts(
        NORMAL, np.repeat(best.parameters, _SAMPLES, axis=0), x, drawn, np.repeat(weight[None], _SAMPLES, axis=0)
    )
    floors, plateaus = floor_and_plateau(samples.parameters)
    floor, plateau = (float(v[0]) for v in floor_and_plateau(best.parameters))
    estimates = (
        _estimate(float(best.quantile(0.5)[0]), samples.quantile(0.5), "ln"),
        _estimate(float(best.quantile(INTERCEPT_LEVEL)[0]), samples.quantile(INTERCEPT_LEVEL), "ln"),
        _estimate(floor, floors, "1"),
        _estimate(plateau, plateaus, "1"),
    )
    grid = np.linspace(x[0], x[-1], 201)
    return _scurve(key, x, p, sd, estimates, grid, best.probability(grid)[0])


def _angle(low: float, high: float) -> float:
    return math.asin(math.sqrt(min(max((high - low) / (1.0 - low), 1e-4), 1.0 - 1e-4)))


def _estimate(value: float, samples: Floats, unit: str) -> Estimate:
    low, high = np.percentile(samples, [5.0, 95.0])
    return Estimate(value, min(float(low), value), max(float(high), value), unit)


def _scurve(
    key: CurveKey, x: Floats, p: Floats, sd: Floats, estimates: tuple[Estimate, Estimate, Estimate, Estimate],
    grid: Floats, drawn: Floats,
) -> SCurve:  # fmt: skip
    half, intercept, floor, plateau = estimates
    reach = Z90 * sd
    return SCurve(
        key=key, log_contrast=x, probability=p, low=np.clip(p - reach, 0.0, 1.0), high=np.clip(p + reach, 0.0, 1.0),
        half=half, intercept=intercept, floor=floor, plateau=plateau, quantile=INTERCEPT_LEVEL, theta=None,
        noise_rms=None, fit_contrast=grid, fit_probability=drawn, answered_resets=math.nan, limited_by=None,
        warnings=(half.note,) if half.note else (),
    )  # fmt: skip
