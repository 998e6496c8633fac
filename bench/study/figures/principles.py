"""Figures that need no study: what is shown, what a pixel does with it, and what theory says."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.report.figures import style
from protocols.expected import on_log_contrast
from protocols.waveforms import reset_test_edges, square_edges

if TYPE_CHECKING:
    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from protocols.stimulus import Stimulus

    Floats = npt.NDArray[np.float64]

__all__ = ["draw_dark_light", "draw_memory", "draw_theory", "draw_waveform"]

_THETA: Final = 0.3
_CORNER_HZ: Final = 50.0
_WINDOW_S: Final = 0.2
_ARMED_S: Final = 0.09
_NOISE: Final = ((0.0607, "background 0.02 Hz"), (0.0724, "background 0.5 Hz"))
_BASE_LUX: Final = 100.0
_AMPLITUDE: Final = 0.33
_OFF: Final = 0.2
_PRINTED: Final = ((0.076, 0.8), (300.0, 0.35))  # lux, log contrast: the intercepts in the paper's text
_DARK_LUX: Final = ((0.1463, "0.8 ln at 76 mlux, threshold 0.35"), (0.2017, "cutoff of 80 mlux, threshold 0.25"))


def draw_theory() -> Figure:
    """Draw the step of an ideal pixel, and the first passage of one with noise."""
    from bench.analysis.noisy_pixel_model import Conditions, Pixels, probability

    contrast = np.linspace(0.0, 0.45, 181)
    conditions = Conditions(1.0 / (2.0 * math.pi * _CORNER_HZ), _WINDOW_S, _ARMED_S, 1e-5)
    figure = style.new_figure(3.1)
    ax = figure.subplots()
    ax.plot([0.0, _THETA, _THETA, 0.45], [0.0, 0.0, 1.0, 1.0], color=style.INK, label="no noise")
    for i, (rms, label) in enumerate(_NOISE):
        pixel = Pixels(theta=_THETA, noise_rms=rms, mismatch=0.0, plateau=1.0, other_ratio=1.0)
        share = probability(np.array([_THETA]), pixel, conditions, contrast)[0]
        colour = tuple(style.POLARITY_COLOURS.values())[i]
        ax.plot(contrast, share, color=colour, label=f"rms {rms:g} ln, {label}")
        half = float(np.interp(0.5, share, contrast))
        ax.plot([half], [0.5], marker="o", color=colour, markerfacecolor="white", markeredgewidth=1.5)
    ax.axhline(0.5, color=style.MUTED, linestyle=":", linewidth=1.0)
    ax.text(0.445, 0.52, "50 %: nominal contrast threshold", ha="right", color=style.MUTED)
    ax.set_ylabel("response probability")
    style.contrast_axis(ax)
    ax.legend(loc="upper left")
    ax.set_xlim(0.0, 0.45)
    return figure


def draw_waveform() -> Figure:
    """Draw two periods of the reset and test pulses that ask for the OFF threshold."""
    low = math.exp(-_THETA)
    light = reset_test_edges(
        baseline_lux=_BASE_LUX,
        reset_lux=_BASE_LUX / 1.5,
        test_lux=_BASE_LUX * low,
        gap_s=0.1,
        reset_s=0.4,
        test_s=0.2,
        cycles=2,
    )
    figure = style.new_figure(2.6)
    ax = figure.subplots()
    _draw_light(ax, light)
    for start, stop in zip(light.pulse_start_s, light.pulse_stop_s, strict=True):
        ax.axvspan(start, stop, color=style.POLARITY_COLOURS["off"], alpha=0.15, linewidth=0)
    for at, text in ((0.3, "reset"), (0.7, "test")):
        for period in (0.0, 0.8):
            ax.text(at + period, 0.06, text, ha="center", color=style.MUTED)
    ax.set_ylim(-0.5, 0.15)
    ax.set_xlabel("time (s)")
    ax.set_ylabel("log light  ln(E / E$_{baseline}$)")
    return figure


def _draw_light(ax: Axes, light: Stimulus) -> None:
    t_s = np.append(light.t_s, light.duration_s)
    level = np.log(np.append(light.lux, light.lux[-1]) / _BASE_LUX)
    ax.step(t_s, level, where="post", color=style.INK)
    ax.set_xlim(0.0, light.duration_s)


def draw_memory() -> Figure:
    """Draw one period of a square wave, what the pixel memorised, and where it would answer, for two dead times."""
    figure = style.new_figure(3.3)
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    light = square_edges(
        period_s=0.2,
        duty=0.5,
        low_lux=_BASE_LUX,
        high_lux=_BASE_LUX * math.exp(_AMPLITUDE),
        cycles=6,
        first_edge_s=0.1,
    )
    begin_s, end_s = float(light.pulse_start_s[1]) - 0.02, float(light.pulse_stop_s[2])
    for ax, dead_s in zip(axes, (1e-4, 1e-2), strict=True):
        t_s = np.arange(begin_s, end_s, 5e-5)
        events_s, on = _events(light, dead_s)
        signal = _low_pass(light, t_s)
        reference = _reference(light, t_s, events_s, dead_s)
        ax.plot(t_s, signal, color=style.INK, label="signal")
        ax.plot(t_s, reference, color=style.MUTED, label="memorised level")
        for name, sign, theta in (("on", 1, _THETA), ("off", -1, _OFF)):
            ax.plot(
                t_s, reference + sign * theta, color=style.POLARITY_COLOURS[name], linestyle="--", linewidth=1.0,
                label=f"{name.upper()} threshold",
            )  # fmt: skip
            chosen = events_s[on if name == "on" else ~on]
            chosen = chosen[(chosen >= begin_s) & (chosen < end_s)]
            ax.plot(
                chosen, _low_pass(light, chosen), linestyle="", marker=style.POLARITY_MARKERS[name], markersize=7,
                color=style.POLARITY_COLOURS[name],
            )  # fmt: skip
        ax.set_title(f"refractory period {dead_s * 1e3:g} ms", loc="left", fontweight="bold")
        ax.set_xlabel("time (s)")
    axes[0].set_ylabel("log light behind the low-pass (ln)")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


def _events(light: Stimulus, dead_s: float) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Return times in s and polarities of the events of a pixel without noise."""
    from protocols.points import Roi
    from sim_backend.pixel import LightHistory, PixelModel, ReferenceEngine, build_chain

    pixel = PixelModel(noise_rms=0.0, corner_hz=_CORNER_HZ, theta_on=_THETA, theta_off=_OFF, refractory_s=dead_s)
    chain = build_chain(pixel, Roi(0, 0, 1, 1), 0)
    found = list(ReferenceEngine().events(chain, LightHistory(light.t_s, light.lux), light.duration_s, 0))
    events = np.concatenate(found)
    return events["t"] * 1e-6, events["p"] == 1


def _low_pass(light: Stimulus, t_s: Floats) -> Floats:
    """Return the log light behind the low-pass, settled at the start: exact between edges."""
    tau_s = 1.0 / (2.0 * math.pi * _CORNER_HZ)
    levels = np.log(light.lux / _BASE_LUX)
    at_edge = np.empty(levels.size)
    at_edge[0] = levels[0]
    for i, keep in enumerate(np.exp(-np.diff(light.t_s) / tau_s)):
        at_edge[i + 1] = levels[i] + (at_edge[i] - levels[i]) * keep
    k = np.searchsorted(light.t_s, t_s, side="right") - 1
    return np.asarray(levels[k] + (at_edge[k] - levels[k]) * np.exp(-(t_s - light.t_s[k]) / tau_s))


def _reference(light: Stimulus, t_s: Floats, events_s: Floats, dead_s: float) -> Floats:
    """Return what is memorised at each time; NaN while the pixel is blind."""
    resets_s = events_s + dead_s
    memorised = np.append(0.0, _low_pass(light, resets_s))
    level = memorised[np.searchsorted(resets_s, t_s, side="right")]
    blind = np.searchsorted(events_s, t_s, side="right") > np.searchsorted(resets_s, t_s, side="right")
    return np.asarray(np.where(blind, np.nan, level))


def draw_dark_light() -> Figure:
    """Draw the log contrast that an ON event needs against illuminance, for both printed dark lights."""
    figure = style.new_figure(3.2)
    ax = figure.subplots()
    lux = np.geomspace(0.03, 1000.0, 200)
    for i, (dark_lux, label) in enumerate(_DARK_LUX):
        needed = [on_log_contrast(float(e), 0.35, dark_lux) for e in lux]
        colour = tuple(style.POLARITY_COLOURS.values())[i]
        ax.plot(lux, needed, color=colour, label=f"dark light {dark_lux * 1e3:.0f} mlux ({label})")
    ax.plot(*zip(*_PRINTED, strict=True), linestyle="", marker="o", color=style.INK, label="printed intercepts")
    style.lux_axis(ax, 0.03, 1000.0)
    ax.set_ylabel("log contrast of an ON event (ln)")
    ax.legend(loc="upper right")
    return figure
