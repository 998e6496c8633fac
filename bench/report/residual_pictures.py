"""What a comparison and a diagnosis show alike: residuals as figures, fitted numbers as cells."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.diagnosis.telling.quantities import number_text
from bench.report import captions
from bench.report.figures import misfit_map, residual_axes
from bench.report.results_table import Cell
from bench.report.showing import Picture
from bench.report.wording import MISSING

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from bench.diagnosis.result import Value
    from bench.diagnosis.telling.by_axis import Bin

__all__ = ["fitted_cell", "fitted_name", "residual_pictures"]


def residual_pictures(of: str, bins: Mapping[int, Sequence[Bin]], labels: Mapping[int, str]) -> Iterator[Picture]:
    """Yield the figures of residuals that make sense.

    Parameters
    ----------
    of
        Begins the names of their files.
    bins
        Residuals along every axis, by the number of the step.
    labels
        What each step is called.
    """
    along = residual_axes.prepare(bins, labels)
    if along is not None:
        yield Picture(
            f"{of}_residuals", "Residuals against every axis", captions.residual_axes(along),
            lambda: residual_axes.draw(along),
        )  # fmt: skip
    cells = misfit_map.prepare(bins, labels)
    if cells is not None:
        yield Picture(
            f"{of}_map", "Which statistics disagree, and where", captions.misfit_map(cells),
            lambda: misfit_map.draw(cells),
        )  # fmt: skip


def fitted_name(key: str) -> Cell:
    """Return the cell that names a fitted number."""
    return Cell(key.replace(".", ": ").replace("_", " "))


def fitted_cell(value: Value | None) -> Cell:
    """Return the cell of a fitted number, its interval below it."""
    text, _, interval = ("", "", "") if value is None else number_text(value).partition(" (")
    return Cell(text or MISSING, interval.removesuffix(")"))
