"""The window of pixels as an image: how many events each pixel sent in the whole run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.report.figures import style

if TYPE_CHECKING:
    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    from bench.analysis.results import Analysis

__all__ = ["EventMapNumbers", "draw", "map_height_in", "prepare"]

_LOG_FROM_RATIO: Final = 20.0  # a few loud pixels would make all others look alike on a linear scale
_COLOUR_QUANTILES: Final = (0.005, 0.995)
_MOST_BINS: Final = 40


@dataclass(frozen=True, slots=True)
class EventMapNumbers:
    """All that the figure shows."""

    events: npt.NDArray[np.int64]  #: (height, width)
    x: int  #: sensor coordinates of the first pixel
    y: int
    total: int
    median: float
    most: int
    silent: int  #: pixels without any event
    loudest: tuple[int, int]  #: x, y of the pixel with most events
    log_scale: bool  #: few pixels sent most of the events
    colour_ends: tuple[float, float]  #: events per pixel at the ends of the colour scale
    edges: npt.NDArray[np.float64]  #: of the histogram, events per pixel; a log one leaves out silent pixels


def prepare(analysis: Analysis) -> EventMapNumbers | None:
    """Return the numbers of the map, or None where it has no pixel."""
    events = analysis.event_map
    if not events.size:
        return None
    x, y = analysis.event_map_origin
    row, column = np.unravel_index(int(np.argmax(events)), events.shape)
    median, most = float(np.median(events)), int(events.max())
    log_scale = most > _LOG_FROM_RATIO * max(median, 1.0)
    return EventMapNumbers(
        events=events,
        x=x,
        y=y,
        total=int(events.sum()),
        median=median,
        most=most,
        silent=int(np.count_nonzero(events == 0)),
        loudest=(x + int(column), y + int(row)),
        log_scale=log_scale,
        colour_ends=(1.0, float(most)) if log_scale else _colour_ends(events),
        edges=_edges(events, log_scale),
    )


def _colour_ends(events: npt.NDArray[np.int64]) -> tuple[float, float]:
    low, high = (float(end) for end in np.quantile(events, _COLOUR_QUANTILES))
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def _edges(events: npt.NDArray[np.int64], log_scale: bool) -> npt.NDArray[np.float64]:
    """Return bins that hold whole numbers of events, as evenly as whole numbers allow."""
    low, high = int(events.min()), int(events.max())
    if log_scale:
        return np.unique(np.floor(np.geomspace(1, high + 1, _MOST_BINS // 2))) - 0.5
    width = max(1, -(-(high - low + 1) // min(_MOST_BINS, max(10, int(2 * np.sqrt(events.size))))))
    return np.arange(low, high + width + 1, width, dtype=np.float64) - 0.5


def draw(numbers: EventMapNumbers) -> Figure:
    """Draw the map in sensor coordinates, and beside it how many pixels sent how many events."""
    height, width = numbers.events.shape
    figure = style.new_figure(map_height_in(width, height))
    left, right = figure.subplots(1, 2, width_ratios=[1.45, 1.0])
    _draw_map(figure, left, numbers)
    _draw_histogram(right, numbers)
    return figure


def _draw_map(figure: Figure, ax: Axes, numbers: EventMapNumbers) -> None:
    from matplotlib import colormaps

    height, width = numbers.events.shape
    image = np.ma.masked_less(numbers.events, 1) if numbers.log_scale else numbers.events
    extent = (numbers.x - 0.5, numbers.x + width - 0.5, numbers.y + height - 0.5, numbers.y - 0.5)
    drawn = ax.imshow(
        image,
        cmap=colormaps["cividis"].with_extremes(bad="#e3e3e3"),
        norm=_norm(numbers),
        extent=extent,
        interpolation="nearest",
        aspect="equal",
    )
    figure.colorbar(drawn, ax=ax, label="events per pixel", pad=0.03, shrink=0.95)
    style.pixel_axes(ax)


def _norm(numbers: EventMapNumbers) -> Normalize:
    from matplotlib.colors import LogNorm, Normalize

    return LogNorm(*numbers.colour_ends) if numbers.log_scale else Normalize(*numbers.colour_ends)


def _draw_histogram(ax: Axes, numbers: EventMapNumbers) -> None:
    counts, _ = np.histogram(numbers.events, numbers.edges)
    ax.stairs(counts, numbers.edges, fill=True, color=style.MUTED, alpha=0.35)
    ax.stairs(counts, numbers.edges, color=style.MUTED, linewidth=1.2)
    if numbers.log_scale:
        ax.set_xscale("log")
    ax.set_ylim(0, 1.08 * max(int(counts.max()), 1))
    ax.set_xlabel("events per pixel")
    style.count_axis(ax)
    ax.set_ylabel("pixels")


def map_height_in(width: int, height: int) -> float:
    """Return the height of a figure that holds a map of this shape beside something else."""
    return float(np.clip(4.0 * height / width + 0.8, 2.4, 4.4))
