"""The page of a comparison: measured against predicted, the residuals along every axis, the numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from bench.diagnosis.telling.by_axis import told_bins
from bench.diagnosis.telling.wording import error_text, pattern_lines, place_text, shortened_parts
from bench.diagnosis.views.registry import all_views
from bench.report import captions
from bench.report.figures import measured_predicted
from bench.report.residual_pictures import fitted_cell, fitted_name, residual_pictures
from bench.report.results_table import Cell, Table
from bench.report.showing import FIGURES, Picture, show
from bench.report.wording import capital
from bench.store.durable import write_whole
from bench.store.layout import PART_SUFFIX

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from bench.diagnosis.comparison import Comparison
    from bench.diagnosis.recorded.position import Pattern
    from bench.diagnosis.telling.by_axis import Bin, Place
    from bench.report.showing import Shown

__all__ = ["PAGE", "comparison_pictures", "write_comparison"]

PAGE: Final = "comparison.html"
_LABELS: Final = {0: "this model"}


@dataclass(frozen=True, slots=True)
class _Section:
    """What the page says."""

    runs: tuple[str, ...]
    headline: str
    notes: tuple[str, ...]  #: of the data, of what part was looked at, and of the pixels' places
    places: tuple[str, ...]
    figures: tuple[Shown, ...]
    parameters: Table
    views: Table


def write_comparison(
    comparison: Comparison, bins: Sequence[Bin], places: Sequence[Place], patterns: Sequence[Pattern], folder: Path
) -> Path:
    """Write the page of a comparison and its figures into `folder`, and return the path of the page.

    Parameters
    ----------
    bins
        Its residuals along every axis.
    places
        Where the model fails most, the worst first.
    patterns
        Among the pixels.
    """
    from bench.report.template import template

    pictures = comparison_pictures(comparison, bins)
    notes = [f"Not fit to judge: {finding}." for finding in comparison.findings]
    notes += [f"Fit to judge, but {caution}." for caution in comparison.cautions]
    notes += [f"{capital(part)}." for part in shortened_parts(comparison.shortened)]
    notes += [f"{capital(line)}." for line in pattern_lines(patterns)]
    section = _Section(
        runs=comparison.runs,
        headline=f"{capital(error_text(comparison.step.error).replace('   ', ', '))}.",
        notes=tuple(notes),
        places=tuple(f"{place_text(place)}." for place in places),
        figures=show(pictures, folder / FIGURES),
        parameters=_parameters(comparison),
        views=_views(bins),
    )
    page = folder / PAGE
    write_whole(page, template(PAGE).render(comparison=section), PART_SUFFIX)
    return page


def comparison_pictures(comparison: Comparison, bins: Sequence[Bin]) -> Iterator[Picture]:
    """Yield the figures of a comparison that make sense, most important first.

    Parameters
    ----------
    bins
        Its residuals along every axis.
    """
    against = measured_predicted.prepare(comparison.residuals, {v.id: v.title for v in all_views()})
    if against is not None:
        yield Picture(
            "comparison_views", "Measured against predicted", captions.measured_predicted(against),
            lambda: measured_predicted.draw(against),
        )  # fmt: skip
    yield from residual_pictures("comparison", {0: bins}, _LABELS)


def _parameters(comparison: Comparison) -> Table:
    rows = tuple((fitted_name(key), fitted_cell(value)) for key, value in comparison.step.parameters.items())
    return Table((("number", ""), ("fitted", "")), rows, 1)


def _views(bins: Sequence[Bin]) -> Table:
    heads = (
        ("view", ""), ("statistics", ""), ("mean square residual", ""), ("by chance", ""), ("mean residual", "sigma"),
        ("by chance", "sigma"),
    )  # fmt: skip
    rows = [
        tuple(map(Cell, (
            b.view.replace("_", " "), f"{b.count}", f"{b.square:.2f}", f"1 \u00b1 {b.square_sd:.2f}",
            f"{b.mean:+.2f}", f"0 \u00b1 {b.mean_sd:.2f}",
        )))
        for b in told_bins(bins, "anywhere")
    ]  # fmt: skip
    return Table(heads, tuple(rows), 1)
