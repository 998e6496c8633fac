"""The report of a study: one HTML file, its figures, and its tables as CSV."""

from __future__ import annotations

import csv
import io
import math
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from bench.report.showing import FIGURES, Picture, show

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from matplotlib.figure import Figure as Drawing

    from bench.analysis.results import Estimate
    from bench.study.claims import Finding
    from bench.study.figure_schema import Figure
    from bench.study.run import StudyResult

__all__ = ["PAGE", "number_text", "write_study_report"]

PAGE: Final = "report.html"
_TABLES: Final = "tables"


def write_study_report(result: StudyResult, folder: Path) -> Path:
    """Write the report into `folder`, and return the path of the page.

    The page needs nothing else; the figures lie in `folder`/figures too, as PNG and PDF, and the tables in
    `folder`/tables as CSV. A figure of which nothing was run is left out. The same result gives the same bytes with
    the same versions of the libraries.
    """
    from bench.report.template import template
    from bench.study.numbers import acceptable_noise, bias_points, recommendations, reset_points

    shown = show(_pictures(result), folder / FIGURES)
    page = template("study.html").render(
        result=result,
        study=result.study,
        findings=[f for f in result.findings if f.verdict != "not run"],
        left_out=sum(f.verdict == "not run" for f in result.findings),
        counts=verdict_counts(result.findings),
        figures=shown,
        variants=_variants(result),
        noise=acceptable_noise(bias_points(result)),
        advice=recommendations(reset_points(result)),
        tables=_write_tables(result, folder / _TABLES),
        number=number_text,
        expectation=expectation_text,
    )
    path = folder / PAGE
    path.write_text(page, encoding="utf-8", newline="\n")
    return path


def verdict_counts(findings: Sequence[Finding]) -> dict[str, int]:
    """Return how many claims have each verdict, in a fixed order."""
    names = ("agrees", "does not agree", "too close to tell", "not determined", "not run")
    return {name: sum(f.verdict == name for f in findings) for name in names}


def _pictures(result: StudyResult) -> Iterator[Picture]:
    for figure in result.study.figures:
        yield Picture(figure.name, figure.title, figure.caption, partial(_draw, result, figure))


def _draw(result: StudyResult, figure: Figure) -> Drawing | None:
    """Return a figure, or None where nothing was run that it shows."""
    from bench.study.figures import curves, grids, principles
    from bench.study.numbers import bias_points, reset_points

    if figure.draws == "curves":
        return curves.draw_curves(result, figure.panels)
    if figure.draws == "bias":
        return grids.draw_bias(bias_points(result))
    if figure.draws == "reset":
        return grids.draw_reset(reset_points(result))
    drawings = {
        "theory": principles.draw_theory,
        "waveform": principles.draw_waveform,
        "memory": principles.draw_memory,
        "dark_light": principles.draw_dark_light,
    }
    return drawings[figure.draws]()


def number_text(estimate: Estimate) -> str:
    """Return a number with its interval as text: ``0.987 (0.980 to 0.994)``."""
    if not math.isfinite(estimate.value):
        return f"\u2013 ({estimate.note})"
    if estimate.low == estimate.high:
        return f"{estimate.value:.3f}"
    return f"{estimate.value:.3f} ({estimate.low:.3f} to {estimate.high:.3f})"


def expectation_text(finding: Finding) -> str:
    """Return what number would bear a claim out: ``1 \u00b1 0.05``, ``above 1.03``."""
    claim = finding.claim
    if claim.above is not None:
        return f"above {claim.above:g}"
    if claim.below is not None:
        return f"below {claim.below:g}"
    if claim.factor is not None:
        return f"{claim.expected:g}, by a factor of {claim.factor:g}"
    return f"{claim.expected:g} \u00b1 {claim.tolerance:g}"


def _variants(result: StudyResult) -> list[dict[str, Any]]:
    return [
        {"variant": v, "seconds": sum(result.outcomes[v.name, s].seconds for s in v.stimuli)} for v in result.variants
    ]


def _write_tables(result: StudyResult, folder: Path) -> list[str]:
    """Write claims.csv, curves.csv, bias.csv and reset.csv, and return their paths relative to the page."""
    from bench.study.numbers import bias_points, reset_points

    tables = {
        "claims": (_CLAIM_HEAD, [_claim_row(f) for f in result.findings]),
        "curves": (_CURVE_HEAD, list(_curve_rows(result))),
        "bias": (
            ("stimulus", "corner_hz", "theta_off_ln", "noise_rms_ln", *_three("rate_hz"), *_three("bias")),
            [
                (p.stimulus, p.corner_hz, p.theta_off, p.noise_rms, *_ends(p.rate), *_ends(p.bias))
                for p in bias_points(result)
            ],
        ),
        "reset": (
            ("quantity", "value", *_three("bias"), *_three("plateau"), "resets_answered"),
            [(p.axis, p.value, *_ends(p.bias), *_ends(p.plateau), p.rearmed) for p in reset_points(result)],
        ),
    }
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name, (head, rows) in tables.items():
        if rows:
            _write_csv(folder / f"{name}.csv", head, rows)
            written.append(f"{_TABLES}/{name}.csv")
    return written


def _three(name: str) -> tuple[str, str, str]:
    return name, f"{name}_low", f"{name}_high"


_CLAIM_HEAD: Final = ("claim", "by", "source", "says", "unit", "least", "most", *_three("measured"), "verdict")
_CURVE_HEAD: Final = (
    "variant", "stimulus", "polarity", *_three("half_ln"), *_three("intercept_ln"), *_three("theta_ln"), "floor",
    "plateau", "resets_answered",
)  # fmt: skip


def _ends(estimate: Estimate | None) -> tuple[float | None, ...]:
    return (None, None, None) if estimate is None else (estimate.value, estimate.low, estimate.high)


def _claim_row(finding: Finding) -> tuple[Any, ...]:
    claim = finding.claim
    return (
        claim.name, claim.by, claim.source, claim.says, claim.unit, *claim.limits, *_ends(finding.measured),
        finding.verdict,
    )  # fmt: skip


def _curve_rows(result: StudyResult) -> Iterator[tuple[Any, ...]]:
    for variant in result.variants:
        for stimulus in variant.stimuli:
            for c in result.outcomes[variant.name, stimulus].curves:
                estimates = (*_ends(c.half), *_ends(c.intercept), *_ends(c.theta))
                shares = (c.floor.value, c.plateau.value, c.answered_resets)
                yield (variant.name, stimulus, c.key.polarity, *estimates, *shares)


def _write_csv(path: Path, head: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows([["" if _missing(cell) else cell for cell in row] for row in rows])
    path.write_text(text.getvalue(), encoding="utf-8", newline="\n")


def _missing(cell: object) -> bool:
    return cell is None or (isinstance(cell, float) and not math.isfinite(cell))
