"""What the change detector of the report's example pixel is thought to do: the fitted pixel, without its noise."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.report.example import choose_example, pixel_events
from bench.report.trace import ModelTrace

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.analysis.results import Analysis, SCurve
    from bench.report.example import Example, RunLike

__all__ = ["model_trace"]

_SAMPLES: Final = 8000
_SETTLE_TAU: Final = 10.0  # how long before the drawn stretch the low-pass starts, in time constants


def model_trace(run: RunLike, analysis: Analysis) -> ModelTrace | None:
    """Return the trace of the fitted pixel beside the events of the report's example pixel.

    The signal is the logarithm of the commanded light behind the fitted first-order low-pass, without noise and dark
    light. The reference is memorised one dead time after each event that was really seen, so the trace says what the
    model makes of this very pixel, not of a simulated one.

    Returns
    -------
    The trace, or None where nothing was fitted, the dead time is not known, or the light was dark.
    """
    example = choose_example(run, analysis)
    if example is None:
        return None
    fitted = [c for c in analysis.curves if c.theta is not None and c.corner_hz is not None and _is_of(c, example)]
    if not fitted or not math.isfinite(example.point.refractory_s) or np.min(example.point.stimulus_lux) <= 0.0:
        return None
    corner = fitted[0].corner_hz
    if corner is None or not corner.value > 0.0:
        return None
    tau_s = 1.0 / (2.0 * math.pi * corner.value)
    t_s, v = _signal(example, tau_s)
    difference = v - _reference(example, t_s, v)
    shown = t_s >= example.start_s
    return ModelTrace(t_s[shown], difference[shown], _theta(fitted, "on"), _theta(fitted, "off"))


def _is_of(curve: SCurve, example: Example) -> bool:
    point = example.point
    return curve.key.waveform == point.waveform and math.isclose(curve.key.baseline_lux, point.baseline_lux)


def _theta(curves: list[SCurve], polarity: str) -> float:
    values = [c.theta.value for c in curves if c.theta is not None and c.key.polarity == polarity]
    return values[0] if values else math.nan


def _signal(example: Example, tau_s: float) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return times (s) and log light behind the low-pass, exact between the edges of the light."""
    t_s = np.linspace(max(0.0, example.start_s - _SETTLE_TAU * tau_s), example.stop_s, _SAMPLES)
    point = example.point
    level = np.searchsorted(point.stimulus_t_s, t_s, side="right") - 1
    u = np.log(point.stimulus_lux[np.maximum(level, 0)])
    keep = math.exp(-float(t_s[1] - t_s[0]) / tau_s)
    v = np.empty_like(u)
    v[0] = u[0]
    for n in range(1, len(u)):
        v[n] = keep * v[n - 1] + (1.0 - keep) * u[n]
    return t_s, v


def _reference(example: Example, t_s: npt.NDArray[np.float64], v: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return the memorised level: the signal at the start, then at the end of each dead time."""
    events_s, _ = pixel_events(example)
    memorised = np.clip(np.searchsorted(t_s, events_s + example.point.refractory_s), 0, len(t_s) - 1)
    reference = np.full_like(v, v[0])
    for start in memorised:
        reference[start:] = v[start]
    return reference
