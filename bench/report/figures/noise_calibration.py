"""Background rate against the rms of the noise, with the rate wanted and the noise that gives it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bench.report.figures import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bench.models.noise_calibration import NoiseCalibration

__all__ = ["draw"]


def draw(found: NoiseCalibration) -> Figure:
    """Draw the counted rates, the line through them, the target and the result with its standard error."""
    figure = style.new_figure(3.4)
    ax = figure.subplots()
    ax.set_yscale("log")
    rms = np.array([c.rms for c in found.counted])
    low, high = min(rms.min(), found.rms), max(rms.max(), found.rms)
    room = 0.25 * (high - low)
    x = np.linspace(low - room, high + room, 100)
    blue = style.POLARITY_COLOURS["on"]
    line = found.target_hz * np.exp(0.5 * found.slope * (1.0 - (found.rms / x) ** 2))
    ax.plot(x, line, color=style.MUTED, label="straight in 1 / rms$^2$")
    style.bars(ax, rms, [c.low_hz for c in found.counted], [c.high_hz for c in found.counted], blue)
    ax.plot(rms, [c.rate_hz for c in found.counted], linestyle="", marker="o", color=blue, label="counted, 90 %")
    ax.axhline(found.target_hz, color=style.INK, linewidth=0.9, linestyle=(0, (4, 3)),
               label=f"wanted: {found.target_hz:g} Hz")  # fmt: skip
    orange = style.POLARITY_COLOURS["off"]
    ax.axvspan(found.rms - found.rms_error, found.rms + found.rms_error, alpha=0.3, color=orange, linewidth=0.0,
               label=f"found: {found.rms:.5f} \u00b1 {found.rms_error:.5f}")  # fmt: skip
    if found.matrix_rms is not None:
        ax.axvline(found.matrix_rms, color=style.INK, linewidth=0.9, linestyle=":",
                   label=f"transition matrix: {found.matrix_rms:.5f}")  # fmt: skip
    ax.set_xlim(x[0], x[-1])
    ends = float(line.min()) / 1.2, float(line.max()) * 1.2
    ax.set_ylim(*ends)
    ticks = style.log_axis_ticks(*ends)
    ax.set_yticks(ticks, [f"{tick:.9f}".rstrip("0").rstrip(".") for tick in ticks])
    ax.minorticks_off()
    ax.set_xlabel("rms of the noise behind the source follower (ln units)")
    ax.set_ylabel("background rate per pixel (Hz)")
    figure.legend(loc="outside right upper")
    return figure
