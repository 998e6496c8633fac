"""Which view fails where: residuals by view and light (or contrast), before anything was added and in the end."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.telling.axis_wording import axis_title, bin_label
from bench.diagnosis.telling.by_axis import ALL_VIEWS
from bench.report.figures import style

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt
    from matplotlib.figure import Figure

    from bench.diagnosis.telling.by_axis import Bin

__all__ = ["MisfitMapNumbers", "draw", "prepare"]

_FEWEST: Final = 2
#: Colours are linear up to so many sigma, and logarithmic above.
_LINEAR: Final = 2.0
_LEAST_REACH: Final = 5.0
_WHITE_ABOVE: Final = 0.55


@dataclass(frozen=True, slots=True)
class MisfitMapNumbers:
    """All that the figure shows."""

    axis: str
    columns: tuple[str, ...]
    views: tuple[str, ...]
    titles: tuple[str, ...]  #: of the maps
    maps: tuple[npt.NDArray[np.float64], ...]  #: (views, columns) rms residual with the sign of the mean; NaN: none


def prepare(bins: Mapping[int, Sequence[Bin]], labels: Mapping[int, str]) -> MisfitMapNumbers | None:
    """Return the numbers of the figure, or None where neither light nor contrast was varied."""
    if not bins:
        return None
    numbers = sorted(bins)
    shown = [numbers[0]] if len(numbers) == 1 else [numbers[0], numbers[-1]]
    for axis in ("illuminance", "contrast", "pulse width"):
        columns = [b for b in bins[shown[0]] if b.axis == axis and b.view == ALL_VIEWS]
        if len(columns) >= _FEWEST:
            break
    else:
        return None
    views = list(dict.fromkeys(b.view for n in shown for b in bins[n] if b.view != ALL_VIEWS))
    return MisfitMapNumbers(
        axis_title(axis),
        tuple(bin_label(b) for b in columns),
        tuple(v.replace("_", " ") for v in views),
        tuple(labels[n] for n in shown),
        tuple(_map([b for b in bins[n] if b.axis == axis], columns, views) for n in shown),
    )


def _map(bins: Sequence[Bin], columns: Sequence[Bin], views: Sequence[str]) -> npt.NDArray[np.float64]:
    out = np.full((len(views), len(columns)), np.nan)
    for one in bins:
        if one.view in views:
            column = next((k for k, c in enumerate(columns) if c.low <= one.low and one.high <= c.high), None)
            if column is not None:
                out[views.index(one.view), column] = math.copysign(math.sqrt(one.square), one.mean)
    return out


def draw(numbers: MisfitMapNumbers) -> Figure:
    """Draw the maps side by side, with a number in each cell."""
    from matplotlib.colors import SymLogNorm

    figure = style.new_figure(1.3 + 0.24 * len(numbers.views))
    axes = figure.subplots(1, len(numbers.maps), sharey=True, squeeze=False)[0]
    reach = max(_LEAST_REACH, *(float(np.nanmax(np.abs(m))) for m in numbers.maps))
    norm = SymLogNorm(_LINEAR, vmin=-reach, vmax=reach)
    for ax, title, values in zip(axes, numbers.titles, numbers.maps, strict=True):
        ax.imshow(values, cmap="RdBu_r", norm=norm, aspect="auto", interpolation="nearest")
        ax.grid(visible=False)
        ax.set_title(title, loc="left")
        ax.set_xticks(range(len(numbers.columns)), numbers.columns, rotation=30, ha="right", rotation_mode="anchor")
        ax.set_xlabel(numbers.axis)
        for (row, column), value in np.ndenumerate(values):
            if np.isfinite(value):
                dark = abs(float(norm(value)) - 0.5) * 2.0 > _WHITE_ABOVE
                text = f"{value:+.0f}" if abs(value) >= 10.0 else f"{value:+.1f}"
                ax.text(
                    column, row, text, ha="center", va="center", fontsize=7.0, color="white" if dark else style.INK
                )
    axes[0].set_yticks(range(len(numbers.views)), numbers.views)
    return figure
