"""Each pixel's own threshold as characterised: a map and a histogram for each polarity."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.report.figures import style
from bench.report.figures.event_map import map_height_in
from bench.report.figures.pixel_maps import common_edges
from bench.report.wording import interval_text, lux_label, polarity_label

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bench.analysis.results import Estimate, ResponsePolarity
    from bench.report.characterized import SavedMismatch

__all__ = ["MismatchNumbers", "PixelThresholds", "draw", "prepare", "sigma_text"]

_FEWEST_PIXELS: Final = 4
_COLOUR_QUANTILES: Final = (0.01, 0.99)


@dataclass(frozen=True, slots=True)
class PixelThresholds:
    """One polarity."""

    polarity: ResponsePolarity
    baseline_lux: float
    theta: npt.NDArray[np.float64]  #: (height, width) ln; NaN where unknown
    median: float  #: ln
    total: float  #: standard deviation of the map, ln
    counting: float  #: what counting pulses alone adds to it (root mean square), ln
    sigma: Estimate  #: of the sensor: what is left without the counting, ln


@dataclass(frozen=True, slots=True)
class MismatchNumbers:
    """All that the figure shows."""

    maps: tuple[PixelThresholds, ...]
    edges: npt.NDArray[np.float64]  #: of the histograms, ln


def prepare(found: Sequence[SavedMismatch]) -> MismatchNumbers | None:
    """Return the numbers of the figure, or None where no map has four pixels or more with a threshold."""
    maps = [_thresholds(m) for m in found if np.count_nonzero(np.isfinite(m.theta)) >= _FEWEST_PIXELS]
    if not maps:
        return None
    values = [m.theta[np.isfinite(m.theta)] for m in maps]
    return MismatchNumbers(tuple(maps), common_edges(np.concatenate(values), max(v.size for v in values)))


def _thresholds(found: SavedMismatch) -> PixelThresholds:
    known = found.theta[np.isfinite(found.theta)]
    errors = found.error[np.isfinite(found.error) & np.isfinite(found.theta)]
    counting = float(np.sqrt(np.mean(errors**2))) if errors.size else math.nan
    return PixelThresholds(
        found.polarity, found.baseline_lux, found.theta, float(np.median(known)), float(known.std(ddof=1)), counting,
        found.sigma,
    )  # fmt: skip


def sigma_text(sigma: Estimate) -> str:
    """Return the mismatch with its interval, in words where none is seen."""
    if not sigma.value > 0.0 or sigma.note:
        return f"none seen, below {sigma.high:.2g}"
    text, interval = interval_text(sigma)
    return f"{text} ({interval})"


def draw(numbers: MismatchNumbers) -> Figure:
    """Draw one row for each polarity: its map and its histogram."""
    height, width = numbers.maps[0].theta.shape
    figure = style.new_figure(len(numbers.maps) * max(2.6, 0.62 * map_height_in(width, height)))
    axes = figure.subplots(len(numbers.maps), 2, squeeze=False, width_ratios=[1.0, 1.15])
    for row, one in enumerate(numbers.maps):
        _draw_map(figure, axes[row, 0], one)
        _draw_histogram(axes[row, 1], one, numbers.edges)
    axes[-1, 1].set_xlabel("threshold of a pixel (ln units)")
    return figure


def _draw_map(figure: Figure, ax: Axes, one: PixelThresholds) -> None:
    from matplotlib import colormaps

    low, high = np.nanquantile(one.theta, _COLOUR_QUANTILES)
    drawn = ax.imshow(
        np.ma.masked_invalid(one.theta), cmap=colormaps["cividis"].with_extremes(bad="#e3e3e3"), vmin=low, vmax=high,
        interpolation="nearest", aspect="equal",
    )  # fmt: skip
    figure.colorbar(drawn, ax=ax, label="threshold (ln)", pad=0.03)
    ax.set_title(f"{polarity_label(one.polarity)}, {lux_label(one.baseline_lux)}", loc="left", fontweight="bold")
    style.pixel_axes(ax)
    ax.set_xlabel("x in the window (pixel)")
    ax.set_ylabel("y in the window (pixel)")


def _draw_histogram(ax: Axes, one: PixelThresholds, edges: npt.NDArray[np.float64]) -> None:
    colour = style.POLARITY_COLOURS[one.polarity]
    counts, _ = np.histogram(one.theta[np.isfinite(one.theta)], edges)
    ax.stairs(counts, edges, fill=True, color=colour, alpha=0.35)
    ax.stairs(counts, edges, color=colour, linewidth=1.2)
    top = 1.55 * max(int(counts.max()), 1)
    ax.axvline(one.median, color=style.INK, linewidth=1.0, linestyle="--", ymax=1.1 / 1.55)
    lines = (
        f"mismatch \u03c3: {sigma_text(one.sigma)}",
        f"spread of the map: {one.total:.2g}",
        f"of which counting pulses: {one.counting:.2g}",
    )
    ax.text(0.98, 0.97, "\n".join(lines), transform=ax.transAxes, ha="right", va="top", fontsize=8.5, linespacing=1.4)
    ax.set_ylim(0, top)
    style.count_axis(ax)
    ax.set_ylabel("pixels")
