"""One pixel: the light on it, its events, and what a model says happens inside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.report.figures import style

if TYPE_CHECKING:
    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bench.report.example import Example
    from bench.report.trace import ModelTrace

__all__ = ["PixelNumbers", "draw", "prepare"]

_LOG_FROM_RATIO: Final = 4.0
_MILLISECONDS_UP_TO_S: Final = 2.0
_ROWS: Final = (("on", 1.0), ("off", 0.0))  # polarity, height of its row of marks
_HEIGHTS_IN: Final = {"light": 1.5, "model": 1.5, "events": 0.75}
_SHADES: Final = {0: "on", 1: "off"}  # kind of a pulse -> polarity that is expected


@dataclass(frozen=True, slots=True)
class PixelNumbers:
    """All that the figure shows; times in s of the recording."""

    start_s: float
    stop_s: float
    light_t_s: npt.NDArray[np.float64]  #: (m,) edges; the first and the last are the ends of the stretch
    light_lux: npt.NDArray[np.float64]  #: (m,) from that edge on
    log_light: bool
    windows_s: npt.NDArray[np.float64]  #: (k, 2) response windows, cut to the stretch
    window_kind: npt.NDArray[np.uint8]  #: (k,) 0 = ON expected, 1 = OFF expected
    on_s: npt.NDArray[np.float64]  #: times of the ON events
    off_s: npt.NDArray[np.float64]  #: times of the OFF events
    trace: ModelTrace | None  #: cut to the stretch


def prepare(
    example: Example,
    event_t_s: npt.NDArray[np.float64],
    event_p: npt.NDArray[np.uint8],
    trace: ModelTrace | None = None,
) -> PixelNumbers:
    """Return the numbers of the figure.

    Parameters
    ----------
    example
        Pixel and stretch of time.
    event_t_s, event_p
        (n,) time in s and polarity (1 = ON) of the events of that pixel in that stretch.
    trace
        What a model says of the same pixel.
    """
    light_t_s, light_lux = _light(example)
    windows_s, kinds = _windows(example)
    lowest, highest = (float(light_lux.min()), float(light_lux.max())) if light_lux.size else (0.0, 0.0)
    return PixelNumbers(
        start_s=example.start_s,
        stop_s=example.stop_s,
        light_t_s=light_t_s,
        light_lux=light_lux,
        log_light=lowest > 0.0 and highest > _LOG_FROM_RATIO * lowest,
        windows_s=windows_s,
        window_kind=kinds,
        on_s=event_t_s[event_p == 1],
        off_s=event_t_s[event_p == 0],
        trace=_cut(trace, example.start_s, example.stop_s),
    )


def _light(example: Example) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    t_s, lux = example.point.stimulus_t_s, example.point.stimulus_lux
    if not t_s.size:
        return np.zeros(0), np.zeros(0)
    inside = (t_s > example.start_s) & (t_s < example.stop_s)
    first = max(int(np.searchsorted(t_s, example.start_s, side="right")) - 1, 0)
    levels = np.concatenate(([lux[first]], lux[inside]))
    return (
        np.concatenate(([example.start_s], t_s[inside], [example.stop_s])),
        np.concatenate((levels, levels[-1:])),
    )


def _windows(example: Example) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint8]]:
    point = example.point
    seen = (point.pulse_stop_s > example.start_s) & (point.pulse_start_s < example.stop_s)
    cut = np.stack((point.pulse_start_s[seen], point.pulse_stop_s[seen]), axis=1)
    return np.clip(cut, example.start_s, example.stop_s), point.pulse_kind[seen]


def _cut(trace: ModelTrace | None, start_s: float, stop_s: float) -> ModelTrace | None:
    if trace is None:
        return None
    inside = (trace.t_s >= start_s) & (trace.t_s <= stop_s)
    return trace._replace(t_s=trace.t_s[inside], difference_ln=trace.difference_ln[inside])


def draw(numbers: PixelNumbers) -> Figure:
    """Draw light, events and, where there is one, the trace of the model, one above the other."""
    rows = ["light", *(["model"] if numbers.trace is not None else []), "events"]
    heights = [_HEIGHTS_IN[row] for row in rows]
    figure = style.new_figure(sum(heights) + 1.1)
    axes = dict(zip(rows, figure.subplots(len(rows), 1, sharex=True, height_ratios=heights), strict=True))
    factor, unit = (1e3, "ms") if numbers.stop_s <= _MILLISECONDS_UP_TO_S else (1.0, "s")
    for ax in axes.values():
        _shade(ax, numbers, factor)
    _draw_light(axes["light"], numbers, factor)
    _draw_events(axes["events"], numbers, factor)
    if numbers.trace is not None:
        _draw_trace(axes["model"], numbers.trace, factor)
    axes["events"].set_xlim(numbers.start_s * factor, numbers.stop_s * factor)
    axes["events"].set_xlabel(f"time since the start of the recording ({unit})")
    figure.align_ylabels(list(axes.values()))
    _legend(figure, numbers)
    return figure


def _shade(ax: Axes, numbers: PixelNumbers, factor: float) -> None:
    for (start, stop), kind in zip(numbers.windows_s.tolist(), numbers.window_kind.tolist(), strict=True):
        colour = style.POLARITY_COLOURS[_SHADES[kind]]
        ax.axvspan(start * factor, stop * factor, facecolor=colour, alpha=0.13, linewidth=0.0, zorder=0)


def _draw_light(ax: Axes, numbers: PixelNumbers, factor: float) -> None:
    ax.step(numbers.light_t_s * factor, numbers.light_lux, where="post", color=style.INK, linewidth=1.3)
    ax.set_ylabel("light on chip\n(lux)")
    if numbers.log_light:
        ax.set_yscale("log")
    elif numbers.light_lux.size:
        lowest, highest = float(numbers.light_lux.min()), float(numbers.light_lux.max())
        room = 0.15 * (highest - lowest) or 0.1 * highest or 1.0
        ax.set_ylim(lowest - room, highest + room)
        ax.ticklabel_format(axis="y", useOffset=False)


def _draw_events(ax: Axes, numbers: PixelNumbers, factor: float) -> None:
    for (polarity, height), times in zip(_ROWS, (numbers.on_s, numbers.off_s), strict=True):
        colour = style.POLARITY_COLOURS[polarity]
        ax.vlines(times * factor, height - 0.32, height + 0.32, colors=colour, linewidth=1.0)
        ax.plot(times * factor, np.full(times.size, height), linestyle="", marker=style.POLARITY_MARKERS[polarity],
                markersize=6.0, color=colour)  # fmt: skip
    ax.set_yticks([0.0, 1.0], ["OFF", "ON"])
    ax.set_ylim(-0.55, 1.55)
    ax.set_ylabel("events")
    ax.grid(visible=False, axis="y")
    ax.tick_params(axis="y", length=0)


def _draw_trace(ax: Axes, trace: ModelTrace, factor: float) -> None:
    ax.plot(trace.t_s * factor, trace.difference_ln, color=style.MUTED, linewidth=0.9)
    for value, polarity in ((trace.theta_on, "on"), (-trace.theta_off, "off")):
        if np.isfinite(value):
            ax.axhline(value, color=style.POLARITY_COLOURS[polarity], linestyle="--", linewidth=1.0)
    ax.set_ylabel("model:\nV \u2212 V$_{ref}$ (ln)")
    ax.set_title("model, not measured", loc="right", fontstyle="italic", fontsize=8.5, pad=3)


def _legend(figure: Figure, numbers: PixelNumbers) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Line2D | Patch] = [
        Line2D([], [], linestyle="", marker=style.POLARITY_MARKERS[polarity], markersize=6.0,
               color=style.POLARITY_COLOURS[polarity], label=f"{polarity.upper()} event")
        for polarity, _ in _ROWS
    ]  # fmt: skip
    for kind in sorted(set(numbers.window_kind.tolist())):
        polarity = _SHADES[kind]
        handles.append(
            Patch(facecolor=style.POLARITY_COLOURS[polarity], alpha=0.2, label=f"response window, {polarity.upper()}")
        )
    if numbers.trace is not None and np.isfinite([numbers.trace.theta_on, numbers.trace.theta_off]).any():
        line = Line2D([], [], color=style.INK, linestyle="--", linewidth=1.0, label="threshold of the model")
        handles.append(line)
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
