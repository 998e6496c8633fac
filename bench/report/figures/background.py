"""Background rates against illuminance: what a pixel sends when the light does not change."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.report.figures import style

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    from bench.analysis.results import BackgroundRow, ResponsePolarity

__all__ = ["BackgroundNumbers", "Rates", "draw", "draw_rates", "legend_handles", "prepare"]

_BESIDE: Final = {"on": -1.0, "off": 1.0}  # ON stands left of its level, OFF right
_NEAREST: Final = 0.006  # places beside a level, as a share of the length of the axis
_FARTHEST: Final = 0.024
_DARK_DECADES: Final = 0.7


@dataclass(frozen=True, slots=True)
class Rates:
    """The rates of one polarity; a rate without events is an upper limit."""

    polarity: ResponsePolarity
    lux: npt.NDArray[np.float64]  #: (n,) as measured; 0 is dark
    place: npt.NDArray[np.float64]  #: (n,) where it is drawn, so that no point hides another
    rate_hz: npt.NDArray[np.float64]  #: (n,) per pixel
    low_hz: npt.NDArray[np.float64]  #: (n,)
    high_hz: npt.NDArray[np.float64]  #: (n,)
    limit: npt.NDArray[np.bool_]  #: (n,) no event was seen: `high_hz` is an upper limit


@dataclass(frozen=True, slots=True)
class BackgroundNumbers:
    """All that the figure shows."""

    rates: tuple[Rates, ...]
    dark_at: float | None  #: the place of 0 lux, or None
    x_limits: tuple[float, float]  #: lux
    y_limits: tuple[float, float]  #: Hz


def prepare(rows: Sequence[BackgroundRow]) -> BackgroundNumbers | None:
    """Return the numbers of the figure, or None where there is no rate to show."""
    usable = [row for row in rows if np.isfinite(row.rate.high) and row.rate.high > 0.0]
    if not usable:
        return None
    lit = sorted({row.baseline_lux for row in usable if row.baseline_lux > 0.0})
    dark_at = None
    if len(lit) < len({row.baseline_lux for row in usable}):
        dark_at = lit[0] * 10.0**-_DARK_DECADES if lit else 1e-3
    polarities: tuple[ResponsePolarity, ResponsePolarity] = ("on", "off")
    groups = [(p, [row for row in usable if row.polarity == p]) for p in polarities]
    ends = style.spread_over([*lit, *([dark_at] if dark_at is not None else [])])
    rates = tuple(_rates(p, members, dark_at, ends) for p, members in groups if members)
    return BackgroundNumbers(rates, dark_at, ends, _y_limits(rates))


def _rates(
    polarity: ResponsePolarity, rows: Sequence[BackgroundRow], dark_at: float | None, ends: tuple[float, float]
) -> Rates:
    lux = np.array([row.baseline_lux for row in rows])
    level = np.where(lux > 0.0, lux, np.nan if dark_at is None else dark_at)
    return Rates(
        polarity=polarity,
        lux=lux,
        place=style.side_by_side(level, _shares(lux) * _BESIDE[polarity], ends),
        rate_hz=np.array([row.rate.value for row in rows]),
        low_hz=np.array([row.rate.low for row in rows]),
        high_hz=np.array([row.rate.high for row in rows]),
        limit=np.array([row.events == 0 for row in rows]),
    )


def _shares(lux: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return how far from its level each rate stands: recordings at the same level stand in a row."""
    shares = np.full(lux.size, _NEAREST)
    for level in np.unique(lux):
        same = np.flatnonzero(lux == level)
        if same.size > 1:
            shares[same] = np.linspace(_NEAREST, _FARTHEST, same.size)
    return shares


def _y_limits(rates: Sequence[Rates]) -> tuple[float, float]:
    """Return the ends of the rate axis: all rates and limits, with room for the arrows below the limits."""
    seen = [v for r in rates for v in np.concatenate((r.rate_hz[~r.limit], r.high_hz, r.low_hz)).tolist() if v > 0.0]
    arrows = any(bool(r.limit.any()) for r in rates)
    return min(seen) / (6.0 if arrows else 2.0), max(seen) * 2.0


def draw(numbers: BackgroundNumbers) -> Figure:
    """Draw both polarities into one panel, on logarithmic axes."""
    figure = style.new_figure(3.6)
    draw_rates(figure.subplots(), numbers)
    figure.legend(handles=legend_handles(numbers), loc="outside right upper")
    return figure


def draw_rates(ax: Axes, numbers: BackgroundNumbers) -> None:
    """Draw both polarities into `ax`, and make its axes."""
    ax.set_yscale("log")
    ax.set_ylim(*numbers.y_limits)
    ticks = style.log_axis_ticks(*numbers.y_limits)
    ax.set_yticks(ticks, [f"{tick:.9f}".rstrip("0").rstrip(".") for tick in ticks])
    ax.minorticks_off()
    for rates in numbers.rates:
        _draw_rates(ax, rates)
    style.lux_axis(ax, *numbers.x_limits, dark_at=numbers.dark_at)
    if numbers.dark_at is not None:
        ax.axvline(numbers.dark_at * 2.2, color=style.MUTED, linewidth=0.8, linestyle=(0, (2, 3)))
    ax.set_ylabel("background rate per pixel (Hz)")


def _draw_rates(ax: Axes, rates: Rates) -> None:
    colour, marker = style.POLARITY_COLOURS[rates.polarity], style.POLARITY_MARKERS[rates.polarity]
    seen, limit = ~rates.limit, rates.limit
    style.bars(ax, rates.place[seen], rates.low_hz[seen], rates.high_hz[seen], colour)
    ax.plot(rates.place[seen], rates.rate_hz[seen], linestyle="", marker=marker, markersize=6.0, color=colour)
    for place, high in zip(rates.place[limit].tolist(), rates.high_hz[limit].tolist(), strict=True):
        ax.annotate(
            "", xy=(place, high / 2.6), xytext=(place, high), arrowprops={"arrowstyle": "->", "color": colour}
        )
    ax.plot(rates.place[limit], rates.high_hz[limit], linestyle="", marker="_", markersize=7.0, color=colour)


def legend_handles(numbers: BackgroundNumbers) -> list[Line2D]:
    """Return what a legend says of the rates."""
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], linestyle="", marker=style.POLARITY_MARKERS[r.polarity], markersize=6.0,
               color=style.POLARITY_COLOURS[r.polarity], label=r.polarity.upper())
        for r in numbers.rates
    ]  # fmt: skip
    if any(bool(r.limit.any()) for r in numbers.rates):
        handles.append(
            Line2D([], [], linestyle="", marker=r"$\downarrow$", markersize=8.0, color=style.INK,
                   label="no event: upper limit")
        )  # fmt: skip
    return handles
