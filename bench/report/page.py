"""The page itself: what the template needs, and its rendering."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.report import results_table as tables
from bench.report.facts import facts_of, software_of
from bench.report.template import template

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.analysis.results import Analysis
    from bench.report.characterization import CharacterizationSection
    from bench.report.diagnosis import DiagnosisSection
    from bench.report.example import RunLike
    from bench.report.showing import Shown

__all__ = ["render"]


def render(
    run: RunLike, analysis: Analysis, figures: Sequence[Shown], csv_files: Sequence[str],
    diagnosis: DiagnosisSection | None = None, characterization: CharacterizationSection | None = None,
) -> str:  # fmt: skip
    """Return the page as HTML. All text that came from files is escaped by the template engine.

    Parameters
    ----------
    run, analysis
        What the page is about.
    figures
        The figures in their order.
    csv_files
        Paths of the tables as CSV, relative to the page.
    diagnosis
        What a section says of the diagnosis of the run; None leaves it out.
    characterization
        Likewise of what the run tells of the sensor.
    """
    facts = facts_of(run)
    return template("report.html").render(
        title=run.header.title or run.header.id,
        run_id=run.header.id,
        headline=tables.headline(analysis, facts.points),
        facts=facts.facts,
        results=tables.key_results(analysis.curves),
        details=tables.curve_details(analysis.curves),
        background=tables.background_table(analysis.background),
        warnings=tables.warned(analysis),
        figures=figures,
        diagnosis=diagnosis,
        characterization=characterization,
        responses=tables.response_table(analysis.responses),
        pixels=tables.pixel_table(analysis.pixel_maps),
        csv_files=csv_files,
        quantiles=sorted({curve.quantile for curve in analysis.curves}),
        software=software_of(run.header),
    )
