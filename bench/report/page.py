"""The page itself: what the template needs, and its rendering."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench.report import results_table as tables
from bench.report.facts import facts_of, software_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from jinja2 import Template

    from bench.analysis.results import Analysis
    from bench.report.characterization import CharacterizationSection
    from bench.report.diagnosis import DiagnosisSection
    from bench.report.example import RunLike

__all__ = ["Shown", "render", "template"]


@dataclass(frozen=True, slots=True)
class Shown:
    """A figure as the page shows it."""

    name: str
    title: str
    caption: str
    image: str  #: a data URI
    files: tuple[str, ...]  #: relative to the page


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


def template(name: str) -> Template:
    """Return one of the pages of this package, to be filled; a name that it uses and does not get is an error."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("bench.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)
