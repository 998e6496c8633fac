"""Figures on their way to a page: drawn in the style of the house, and written to files beside it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

    from matplotlib.figure import Figure

__all__ = ["FIGURES", "Picture", "Shown", "show", "write_figures"]

#: The folder of the figures, beside the page.
FIGURES: Final = "figures"


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure, not yet drawn."""

    name: str  #: of its files
    title: str
    caption: str  #: what it shows and what to look at
    draw: Callable[[], Figure | None]  #: None if it turns out that there is nothing to draw


@dataclass(frozen=True, slots=True)
class Shown:
    """A figure as the page shows it."""

    name: str
    title: str
    caption: str
    image: str  #: a data URI
    files: tuple[str, ...]  #: relative to the page


def show(pictures: Iterable[Picture], folder: Path) -> tuple[Shown, ...]:
    """Draw figures, write their files, and return what the page needs of them.

    Parameters
    ----------
    pictures
        Drawn one after the other.
    folder
        :data:`FIGURES` beside the page; made if it is not there.
    """
    from bench.report.saving import svg_data_uri

    return tuple(
        Shown(p.name, p.title, p.caption, svg_data_uri(figure), tuple(f"{FIGURES}/{path.name}" for path in files))
        for p, figure, files in _drawn(pictures, folder)
    )


def write_figures(pictures: Iterable[Picture], folder: Path) -> tuple[Path, ...]:
    """Draw figures into a folder, as PNG and PDF, and return the paths of the files in their order."""
    return tuple(path for _, _, files in _drawn(pictures, folder) for path in files)


def _drawn(pictures: Iterable[Picture], folder: Path) -> Iterator[tuple[Picture, Figure, tuple[Path, ...]]]:
    from bench.report.figures.style import house_style
    from bench.report.saving import lay_out, save_figure

    folder.mkdir(parents=True, exist_ok=True)
    with house_style():
        for picture in pictures:
            figure = picture.draw()
            if figure is not None:
                lay_out(figure)
                yield picture, figure, save_figure(figure, folder, picture.name)
