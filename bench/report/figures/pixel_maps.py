"""Each pixel's own threshold: a map for each polarity, and how the pixels are distributed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.report.figures import style
from bench.report.figures.event_map import map_height_in
from bench.report.wording import lux_label, polarity_label

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bench.analysis.results import CurveKey, PixelMap

__all__ = ["PixelMapNumbers", "Spread", "common_edges", "draw", "prepare", "spread_of"]

_FEWEST_PIXELS: Final = 4
_COLOUR_QUANTILES: Final = (0.01, 0.99)


@dataclass(frozen=True, slots=True)
class Spread:
    """How the pixels of one map are distributed, ln units."""

    key: CurveKey
    pixels: int  #: pixels whose answers determine a threshold
    of: int  #: pixels of the window
    median: float
    total: float  #: standard deviation between pixels
    counting: float  #: what counting pulses alone adds to it (root mean square)
    own: float  #: what is left: sqrt(total^2 - counting^2), or 0 where counting explains all of it


@dataclass(frozen=True, slots=True)
class PixelMapNumbers:
    """All that the figure shows: one map for each polarity."""

    maps: tuple[tuple[Spread, npt.NDArray[np.float64]], ...]
    x: int  #: sensor coordinates of the first pixel
    y: int
    edges: npt.NDArray[np.float64]  #: of the histograms, ln
    others: int  #: maps that the analysis has and the figure does not show


def spread_of(pixel_map: PixelMap) -> Spread:
    """Return how the pixels of a map are distributed; NaN where no pixel has a threshold."""
    known = np.isfinite(pixel_map.half)
    values, errors = pixel_map.half[known], pixel_map.counting_error[known]
    pixels = int(values.size)
    total = float(np.std(values, ddof=1)) if pixels > 1 else math.nan
    finite = errors[np.isfinite(errors)]
    counting = float(np.sqrt(np.mean(finite**2))) if finite.size else math.nan
    return Spread(
        key=pixel_map.key,
        pixels=pixels,
        of=int(pixel_map.half.size),
        median=float(np.median(values)) if pixels else math.nan,
        total=total,
        counting=counting,
        own=math.sqrt(max(total**2 - counting**2, 0.0)),
    )


def prepare(maps: Sequence[PixelMap], origin: tuple[int, int]) -> PixelMapNumbers | None:
    """Return the numbers of the figure.

    Of each polarity the map is taken that determines most pixels; of equals, the brightest. None where no map
    determines at least four pixels.
    """
    chosen = []
    for polarity in ("on", "off"):
        usable = [(spread_of(m), m) for m in maps if m.key.polarity == polarity]
        usable = [pair for pair in usable if pair[0].pixels >= _FEWEST_PIXELS]
        if usable:
            spread, best = max(usable, key=lambda pair: (pair[0].pixels, pair[1].key.baseline_lux))
            chosen.append((spread, best.half))
    if not chosen:
        return None
    values = np.concatenate([half[np.isfinite(half)] for _, half in chosen])
    edges = common_edges(values, max(spread.pixels for spread, _ in chosen))
    return PixelMapNumbers(tuple(chosen), *origin, edges, len(maps) - len(chosen))


def common_edges(values: npt.NDArray[np.float64], pixels: int) -> npt.NDArray[np.float64]:
    """Return common bins for all histograms; a few wild pixels do not stretch them."""
    low, high = np.quantile(values, [0.005, 0.995])
    room = max(0.15 * (high - low), 1e-3)
    bins = int(np.clip(2.0 * np.sqrt(pixels), 10, 45))
    return np.linspace(max(0.0, low - room), high + room, bins + 1)


def draw(numbers: PixelMapNumbers) -> Figure:
    """Draw one row for each polarity: its map and its histogram."""
    height, width = numbers.maps[0][1].shape
    figure = style.new_figure(len(numbers.maps) * max(2.5, 0.62 * map_height_in(width, height)))
    axes = figure.subplots(len(numbers.maps), 2, squeeze=False, width_ratios=[1.0, 1.15])
    for row, (spread, half) in enumerate(numbers.maps):
        _draw_map(figure, axes[row, 0], spread, half, numbers)
        _draw_histogram(axes[row, 1], spread, half, numbers.edges)
    axes[-1, 1].set_xlabel("50 % point of a pixel, log contrast (ln units)")
    return figure


def _draw_map(
    figure: Figure, ax: Axes, spread: Spread, half: npt.NDArray[np.float64], numbers: PixelMapNumbers
) -> None:
    from matplotlib import colormaps

    height, width = half.shape
    low, high = np.nanquantile(half, _COLOUR_QUANTILES)
    extent = (numbers.x - 0.5, numbers.x + width - 0.5, numbers.y + height - 0.5, numbers.y - 0.5)
    drawn = ax.imshow(
        np.ma.masked_invalid(half), cmap=colormaps["cividis"].with_extremes(bad="#e3e3e3"), vmin=low, vmax=high,
        extent=extent, interpolation="nearest", aspect="equal",
    )  # fmt: skip
    figure.colorbar(drawn, ax=ax, label="50 % point (ln)", pad=0.03)
    ax.set_title(f"{polarity_label(spread.key.polarity)}, {lux_label(spread.key.baseline_lux)}", loc="left",
                 fontweight="bold")  # fmt: skip
    style.pixel_axes(ax)


def _draw_histogram(ax: Axes, spread: Spread, half: npt.NDArray[np.float64], edges: npt.NDArray[np.float64]) -> None:
    colour = style.POLARITY_COLOURS[spread.key.polarity]
    counts, _ = np.histogram(half[np.isfinite(half)], edges)
    ax.stairs(counts, edges, fill=True, color=colour, alpha=0.35)
    ax.stairs(counts, edges, color=colour, linewidth=1.2)
    ax.axvline(spread.median, color=style.INK, linewidth=1.0, linestyle="--")
    lines = (
        f"median {spread.median:.3f}",
        f"spread {spread.total:.3f}",
        f"counting {spread.counting:.3f}",
    )
    ax.text(
        0.985, 0.96, "\n".join(lines), transform=ax.transAxes, ha="right", va="top", fontsize=8.5, linespacing=1.4
    )
    ax.set_ylim(0, 1.3 * max(int(counts.max()), 1))
    style.count_axis(ax)
    ax.set_ylabel("pixels")
