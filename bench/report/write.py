"""Write the report of a run: the page, and its figures as separate files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from pathlib import Path

    from bench.analysis.results import Analysis
    from bench.report.example import RunLike
    from bench.report.trace import ModelTrace

__all__ = ["PAGE", "write_report"]

PAGE: Final = "report.html"
_TABLES: Final = "tables"


def write_report(
    run: RunLike, analysis: Analysis, folder: Path, *, model_trace: ModelTrace | None = None,
    diagnosis: Path | None = None, characterization: Path | None = None,
) -> Path:  # fmt: skip
    """Write the report of `run` into `folder`, and return the path of the page.

    The page is one HTML file that needs nothing else: no network, no file beside it. The figures lie in
    `folder`/figures too, as PNG and PDF, and the tables in `folder`/tables, as CSV. The same run gives the same bytes
    with the same versions of the libraries.

    Parameters
    ----------
    run
        The run; its header, its points and the events of one example pixel are read.
    analysis
        What analysis found in it.
    folder
        Made if it is not there; a report that is there already is replaced.
    model_trace
        What a model says of the example pixel, see :func:`bench.report.example.choose_example`; drawn as a model.
    diagnosis
        Folder with the results of a diagnosis of this run; if it holds one, a section shows it.
    characterization
        Folder with what characterisation found in this run; likewise.

    Raises
    ------
    bench.store.errors.RunError
        If a point of the run is damaged.
    InputError
        If the diagnosis or the characterization cannot be read.
    """
    from bench.analysis.tables import write_csv
    from bench.report.characterization import characterization_section
    from bench.report.diagnosis import diagnosis_section
    from bench.report.gallery import pictures
    from bench.report.page import render
    from bench.report.showing import FIGURES, show

    figures = folder / FIGURES
    shown = show(pictures(run, analysis, model_trace), figures)
    section = None if diagnosis is None else diagnosis_section(diagnosis, figures)
    sensor = None if characterization is None else characterization_section(characterization, figures)
    tables = [f"{_TABLES}/{path.name}" for path in write_csv(analysis, folder / _TABLES)]
    page = folder / PAGE
    page.write_text(render(run, analysis, shown, tables, section, sensor), encoding="utf-8", newline="\n")
    return page
