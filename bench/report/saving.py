"""From a figure to files and to text that a page can hold: the same bytes each time."""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

__all__ = ["lay_out", "save_figure", "svg_data_uri"]

# Matplotlib writes the date, and its own address, unless told not to.
_METADATA: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "Creator": "EVS bench", "Producer": None},
    "svg": {"Date": None, "Creator": None, "Format": None, "Type": None},
}


def lay_out(figure: Figure) -> None:
    """Place everything once and for all, so that it is not done again for every file."""
    figure.draw_without_rendering()
    figure.set_layout_engine(None)


def save_figure(figure: Figure, folder: Path, name: str) -> tuple[Path, Path]:
    """Write `figure` to `folder` as PNG and as PDF, and return both paths."""
    paths = (folder / f"{name}.png", folder / f"{name}.pdf")
    for path in paths:
        kind = path.suffix[1:]
        figure.savefig(path, format=kind, metadata=_METADATA[kind])
    return paths


def svg_data_uri(figure: Figure) -> str:
    """Return `figure` as the address of an image that holds itself (an SVG whose letters are outlines)."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="svg", metadata=_METADATA["svg"])
    return "data:image/svg+xml;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
