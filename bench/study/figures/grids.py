"""Figures of the grids: the bias of the intercept, and what reset and test pulses do."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from bench.report.figures import style
from bench.study.numbers import ACCEPTABLE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bench.study.numbers import BiasPoint, ResetPoint

__all__ = ["draw_bias", "draw_reset"]

_STIMULI: Final = (("square", "Square wave"), ("reset_test", "Reset and test pulses"))
_AXES: Final = {
    "reset_contrast": "reset amplitude\n(linear contrast)",
    "gap_s": "gap (s)",
    "reset_s": "reset pulse (s)",
    "test_s": "test pulse\nand window (s)",
    "window_s": "response\nwindow (s)",
}
_PER_CENT: Final = 100.0


def draw_bias(points: Sequence[BiasPoint]) -> Figure | None:
    """Draw the bias of the intercept against the background rate: rows are stimuli, columns corners."""
    if not points:
        return None
    corners = sorted({p.corner_hz for p in points})
    thresholds = sorted({p.theta_off for p in points}, reverse=True)
    figure = style.new_figure(5.6)
    axes = figure.subplots(2, len(corners), sharex=True, sharey=True, squeeze=False)
    for row, (stimulus, name) in zip(axes, _STIMULI, strict=True):
        for ax, corner in zip(row, corners, strict=True):
            ax.axhspan(-_PER_CENT * ACCEPTABLE, _PER_CENT * ACCEPTABLE, color=style.MUTED, alpha=0.15, linewidth=0)
            ax.axhline(0.0, color=style.MUTED, linewidth=0.8)
            for i, off in enumerate(thresholds):
                mine = [p for p in points if (p.stimulus, p.corner_hz, p.theta_off) == (stimulus, corner, off)]
                _draw_line(ax, mine, i, style.step_colour(i, len(thresholds)), f"{off:.2f}")
            ax.set_title(f"{name}, {corner:g} Hz", loc="left", fontsize=9.0, fontweight="bold")
            ax.set_xscale("log")
        row[0].set_ylabel("bias of the intercept (%)")
    for ax in axes[-1]:
        ax.set_xlabel("background rate (Hz per pixel)")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside lower center", ncols=len(labels), title="OFF threshold (ln); ON: 0.30"
    )
    return figure


def _draw_line(
    ax: Axes, points: Sequence[BiasPoint], step: int, colour: tuple[float, float, float, float], label: str
) -> None:
    known = sorted((p for p in points if math.isfinite(p.bias.value)), key=lambda p: p.noise_rms)
    seen = [p for p in known if p.rate.value > 0.0]
    ax.plot(
        [p.rate.value for p in seen], [_PER_CENT * p.bias.value for p in seen], color=colour, linewidth=1.0,
        label=label, **style.point(step, colour),
    )  # fmt: skip
    for p in seen:
        style.bars(ax, p.rate.value, _PER_CENT * p.bias.low, _PER_CENT * p.bias.high, colour)
    silent = [p for p in known if not p.rate.value > 0.0]
    ax.plot(
        [p.rate.high for p in silent], [_PER_CENT * p.bias.value for p in silent], linestyle="", marker="<",
        markerfacecolor="white", markeredgecolor=colour, markersize=6.0,
    )  # fmt: skip


def draw_reset(points: Sequence[ResetPoint]) -> Figure | None:
    """Draw bias, plateau and answered resets against each quantity of the reset and test pulses."""
    if not points:
        return None
    names = [name for name in _AXES if any(p.axis == name for p in points)]
    figure = style.new_figure(4.6)
    axes = figure.subplots(2, len(names), sharex="col", sharey="row", squeeze=False)
    bias_colour, rearmed_colour = style.POLARITY_COLOURS["on"], style.POLARITY_COLOURS["off"]
    for column, name in enumerate(names):
        mine = sorted((p for p in points if p.axis == name), key=lambda p: p.value)
        upper, lower = axes[0, column], axes[1, column]
        x = [p.value for p in mine]
        upper.axhspan(-_PER_CENT * ACCEPTABLE, _PER_CENT * ACCEPTABLE, color=style.MUTED, alpha=0.15, linewidth=0)
        upper.plot(x, [_PER_CENT * p.bias.value for p in mine], color=bias_colour, marker="s")
        style.bars(
            upper, x, [_PER_CENT * p.bias.low for p in mine], [_PER_CENT * p.bias.high for p in mine], bias_colour
        )
        lower.plot(x, [p.plateau.value for p in mine], color=bias_colour, marker="o", label="plateau")
        lower.plot(
            x, [p.rearmed for p in mine], color=rearmed_colour, marker="v", linestyle="--", label="resets answered"
        )
        lower.set_xscale("log")
        lower.set_xlim(x[0] / 1.5, x[-1] * 1.5)
        ticks = style.log_axis_ticks(x[0], x[-1], 2)[:4]
        lower.set_xticks(ticks, [f"{t:g}" for t in ticks])
        lower.minorticks_off()
        lower.set_xlabel(_AXES[name])
    axes[0, 0].set_ylabel("bias of the intercept (%)")
    axes[1, 0].set_ylabel("share")
    axes[1, 0].set_ylim(0.0, 1.05)
    handles, labels = axes[1, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2)
    return figure
