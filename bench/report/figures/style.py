"""One look for all figures: colours that colour-blind readers tell apart, markers that survive a grey printer."""

from __future__ import annotations

import math
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench.report.wording import lux_label

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.typing import ColorType

__all__ = [
    "INK",
    "MARKERS",
    "MUTED",
    "POLARITY_COLOURS",
    "POLARITY_MARKERS",
    "WIDTH_IN",
    "bars",
    "contrast_axis",
    "count_axis",
    "house_style",
    "linear_contrast_axis",
    "linear_contrast_ticks",
    "log_axis_ticks",
    "lux_axis",
    "new_figure",
    "pixel_axes",
    "plain_log_axis",
    "point",
    "side_by_side",
    "spread_over",
    "step_colour",
]

WIDTH_IN: Final = 8.6  #: all figures are equally wide, so that their letters are equally large on the page
POLARITY_COLOURS: Final = {"on": "#0072B2", "off": "#D55E00"}
POLARITY_MARKERS: Final = {"on": "^", "off": "v"}
MARKERS: Final = ("o", "s", "^", "D", "v", "P", "X", "*", "<", ">", "p", "h")
INK: Final = "#222222"
MUTED: Final = "#6b6b6b"
_LIGHTEST: Final = 0.86  #: the upper end of the colour map is too pale on paper
_LINEAR_TICKS: Final = (  # those that are named first are wanted most
    (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0),
    (0.3, 0.7, 1.5, 3.0, 4.0, 7.0, 15.0, 30.0, 70.0),
    (0.05, 0.15, 0.4, 0.02, 0.01),
)
_LOG_STEPS: Final = ((1.0,), (1.0, 3.0), (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0))
_TICK_ROOM: Final = 0.1  #: least distance of two ticks of the upper axis, as a share of its length
_STYLE: Final = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.3,
    "lines.markersize": 4.5,
    "svg.hashsalt": "evs-bench",
    "svg.fonttype": "path",
    "pdf.fonttype": 3,
    "savefig.dpi": 170,
}


@contextmanager
def house_style() -> Iterator[None]:
    """Draw and save figures in the style of the report; the caller's own settings come back afterwards."""
    import matplotlib as mpl

    with mpl.rc_context(_STYLE):  # type: ignore[arg-type] # the stubs list every key by name
        yield


def new_figure(height_in: float) -> Figure:
    """Return an empty figure of the common width."""
    from matplotlib.figure import Figure

    return Figure(figsize=(WIDTH_IN, height_in), layout="constrained")


def step_colour(index: int, steps: int) -> tuple[float, float, float, float]:
    """Return the colour of one of `steps` ordered values: dark for the first, lighter towards the last."""
    from matplotlib import colormaps

    place = 0.35 if steps == 1 else _LIGHTEST * index / (steps - 1)
    red, green, blue, alpha = colormaps["viridis"](place)
    return float(red), float(green), float(blue), float(alpha)


def bars(
    ax: Axes,
    x: npt.ArrayLike,
    low: npt.ArrayLike,
    high: npt.ArrayLike,
    colour: ColorType,
    *,
    horizontal: bool = False,
) -> None:
    """Draw intervals as thin lines; `x` is the coordinate that they share with their points."""
    draw = ax.hlines if horizontal else ax.vlines
    draw(x, low, high, color=colour, linewidth=1.1, alpha=0.75, zorder=2)


def contrast_axis(ax: Axes) -> None:
    """Label the axis of log contrasts, with ticks that leave room for their labels."""
    from matplotlib.ticker import MaxNLocator

    ax.xaxis.set_major_locator(MaxNLocator(8, steps=[1, 2, 5, 10]))
    ax.set_xlabel("log contrast  ln(E$_{max}$ / E$_{min}$)")


def linear_contrast_ticks(low: float, high: float) -> npt.NDArray[np.float64]:
    """Return round linear contrasts between the log contrasts `low` and `high`, far enough apart to be read."""
    room = _TICK_ROOM * (high - low)
    kept: list[float] = []
    for tick in (tick for ticks in _LINEAR_TICKS for tick in ticks):
        place = math.log1p(tick)
        if low <= place <= high and all(abs(place - math.log1p(other)) >= room for other in kept):
            kept.append(tick)
    return np.array(sorted(kept))


def linear_contrast_axis(ax: Axes, low: float, high: float) -> None:
    """Add an upper axis of linear contrast, E_max / E_min - 1."""
    ticks = linear_contrast_ticks(low, high)
    top = ax.secondary_xaxis("top")
    top.set_xticks(np.log1p(ticks), [f"{tick:g}" for tick in ticks])
    top.set_xlabel("linear contrast  E$_{max}$ / E$_{min}$ \u2212 1", labelpad=5)
    top.minorticks_off()


def log_axis_ticks(low: float, high: float, fewest: int = 3) -> npt.NDArray[np.float64]:
    """Return round values for a logarithmic axis from `low` to `high`: decades, and more where they are too few."""
    decades = [10.0**n for n in range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)]
    inside: list[float] = []
    for steps in _LOG_STEPS:
        inside = [step * decade for decade in decades for step in steps if low <= step * decade <= high]
        if len(inside) >= fewest:
            break
    return np.array(inside if inside else [math.sqrt(low * high)])


def lux_axis(ax: Axes, low: float, high: float, *, dark_at: float | None = None, fewest: int = 3) -> None:
    """Make the x axis a logarithmic axis of illuminance on chip from `low` to `high` lux, both above 0.

    `dark_at` is the place that stands for no light at all, which a logarithmic axis has no room for;
    `fewest` is the least number of ticks.
    """
    ax.set_xscale("log")
    ax.set_xlim(low, high)
    ticks = [tick for tick in log_axis_ticks(low, high, fewest).tolist() if dark_at is None or tick > 1.5 * dark_at]
    labels = [lux_label(tick) for tick in ticks]
    if dark_at is not None:
        ticks, labels = [dark_at, *ticks], ["dark", *labels]
    ax.set_xticks(ticks, labels)
    ax.minorticks_off()
    ax.set_xlabel("illuminance on chip")


def plain_log_axis(ax: Axes) -> None:
    """Make the y axis logarithmic, with plain numbers at its ticks; its limits are set before."""
    low, high = ax.get_ylim()
    ax.set_yscale("log")
    ticks = log_axis_ticks(low, high)
    ax.set_ylim(low, high)
    ax.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.minorticks_off()


def spread_over(values: Sequence[float]) -> tuple[float, float]:
    """Return limits for a logarithmic axis that holds `values` (all above 0) with some room."""
    low, high = min(values), max(values)
    room = max(1.6, (high / low) ** 0.06)
    return low / room, high * room


def point(step: int, colour: str | tuple[float, ...]) -> dict[str, Any]:
    """Return the look of the measured points of one step: marker by index, filled, with a thin edge."""
    marker = MARKERS[step % len(MARKERS)]
    size = 5.5 if marker in "*PX" else 4.2
    return {
        "marker": marker,
        "markersize": size,
        "markerfacecolor": colour,
        "markeredgecolor": colour,
        "markeredgewidth": 0.4,
    }


def pixel_axes(ax: Axes) -> None:
    """Label the axes of a map of pixels: sensor coordinates, whole numbers, no grid."""
    from matplotlib.ticker import MaxNLocator

    ax.grid(visible=False)
    ax.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    ax.yaxis.set_major_locator(MaxNLocator(6, integer=True))
    ax.ticklabel_format(useOffset=False, style="plain")
    ax.set_xlabel("x (pixel)")
    ax.set_ylabel("y (pixel)")


def count_axis(ax: Axes) -> None:
    """Let the y axis count in whole numbers."""
    from matplotlib.ticker import MaxNLocator

    ax.yaxis.set_major_locator(MaxNLocator(6, integer=True))


def side_by_side(
    x: npt.NDArray[np.float64], share: npt.ArrayLike, ends: tuple[float, float]
) -> npt.NDArray[np.float64]:
    """Return places beside `x` on a logarithmic axis with these `ends`, shifted by a share of its length."""
    return np.asarray(x * (ends[1] / ends[0]) ** np.asarray(share, np.float64), np.float64)
