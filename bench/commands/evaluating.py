"""What `analyze`, `report` and `demo` share: turning a run into results, and results into a report."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from pathlib import Path

    from bench.analysis.results import Analysis
    from bench.store import Run

__all__ = ["CHARACTERIZATION", "DIAGNOSIS", "evaluate", "make_report"]

#: Where a diagnosis of a run lies, in the folder of its results.
DIAGNOSIS: Final = "diagnosis"
#: Where its characterization lies, likewise.
CHARACTERIZATION: Final = "characterization"


def evaluate(run: Run, folder: Path, *, pixel_maps: bool = True) -> tuple[Analysis, Path]:
    """Analyse `run`, write the tables into `folder`, and return the results and where the tables are.

    What is missing from the run, damaged or changed in it, stands first among the warnings.
    """
    from bench.analysis import analyze
    from bench.analysis.tables import save

    analysis = analyze(run, pixel_maps=pixel_maps)
    warnings = (*(f"left out: {line}" for line in run.damaged), *run.remarks(), *analysis.warnings)
    analysis = replace(analysis, damaged=run.damaged, warnings=warnings)
    return analysis, save(analysis, folder)


def make_report(run: Run, analysis: Analysis, folder: Path) -> Path:
    """Write the report of `run` into the folder `report` of `folder`, and return its page.

    A diagnosis in the folder `diagnosis` of `folder` is shown too, and a characterization in `characterization`.
    """
    from bench.models.trace import model_trace
    from bench.report import write_report

    return write_report(
        run, analysis, folder / "report", model_trace=model_trace(run, analysis), diagnosis=folder / DIAGNOSIS,
        characterization=folder / CHARACTERIZATION,
    )  # fmt: skip
