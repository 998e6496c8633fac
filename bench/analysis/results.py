"""What analysis finds in a run: plain frozen dataclasses, numbers only.

Intervals are 90 % intervals unless said otherwise, and count pixels, not pulses, as independent: the pulses of one
pixel share its frozen threshold, and are not independent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

__all__ = [
    "Analysis",
    "BackgroundRow",
    "CurveKey",
    "Estimate",
    "PixelMap",
    "ResponseRow",
    "SCurve",
]

ResponsePolarity = Literal["on", "off"]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its interval. NaN where the data do not determine it; `note` says why."""

    value: float
    low: float
    high: float
    unit: str
    note: str = ""


@dataclass(frozen=True, slots=True)
class CurveKey:
    """What the points of one S-curve have in common."""

    waveform: Literal["square", "reset_test"]
    polarity: ResponsePolarity
    baseline_lux: float
    nd_od: float
    pulse_width_s: float  #: length of the test pulse, s
    settings: str  #: label of the bias settings, empty where a run has only one


@dataclass(frozen=True, slots=True)
class ResponseRow:
    """The answers of all pixels to all test pulses of one polarity of one point."""

    point: int
    key: CurveKey
    log_contrast: float
    pulses: int
    pixels: int
    responses: int  #: pixel-pulses with at least one event of the pulse's polarity in the window
    probability: float
    low: float
    high: float
    events_per_pulse: float  #: events of the pulse's polarity in its window, per pixel and pulse
    answered_resets: float  #: share of pixel-resets that fired the re-arming polarity; NaN without resets
    per_pixel: npt.NDArray[np.integer]  #: (pixels,) responses of each pixel, row by row of the window
    latency_edges_s: npt.NDArray[np.float64]  #: (b + 1,)
    latency_counts: npt.NDArray[np.int64]  #: (b,) first events of the pulse's polarity after its edge
    latency_median_s: float
    latency_iqr_s: float


@dataclass(frozen=True, slots=True)
class SCurve:
    """An S-curve and what was read off it. Contrasts are ln(E_max / E_min)."""

    key: CurveKey
    log_contrast: npt.NDArray[np.float64]  #: (n,) ascending
    probability: npt.NDArray[np.float64]  #: (n,)
    low: npt.NDArray[np.float64]  #: (n,)
    high: npt.NDArray[np.float64]  #: (n,)
    half: Estimate  #: 50 % point (nominal contrast threshold) of a Gaussian CDF
    intercept: Estimate  #: the contrast where the fit reaches floor + 0.99 (plateau - floor)
    floor: Estimate
    plateau: Estimate
    quantile: float  #: 0.99
    theta: Estimate | None  #: threshold from the fit of a noisy pixel; None where it was not fitted
    noise_rms: Estimate | None  #: noise at the comparator from the same fit, ln units
    fit_contrast: npt.NDArray[np.float64]  #: (g,) the fitted curve, for drawing
    fit_probability: npt.NDArray[np.float64]  #: (g,)
    answered_resets: float  #: the lowest share among its points that matter; NaN without resets
    limited_by: ResponsePolarity | None  #: square wave: the curve shows this other, less sensitive threshold
    warnings: tuple[str, ...]
    theta_99: tuple[float, float] | None = None  #: 99 % interval of `theta`
    mismatch: Estimate | None = None  #: spread of the threshold over the pixels, from the same fit, ln units
    corner_hz: Estimate | None = None  #: corner of the low-pass, from the same fit


@dataclass(frozen=True, slots=True)
class BackgroundRow:
    """Background events of one polarity in one constant point."""

    point: int
    polarity: ResponsePolarity
    baseline_lux: float
    nd_od: float
    events: int
    pixel_seconds: float
    rate: Estimate  #: events per pixel and second (Hz)
    settings: str = ""  #: label of the bias settings, empty where a run has only one


@dataclass(frozen=True, slots=True)
class PixelMap:
    """Each pixel's own 50 % point for one S-curve; NaN where its answers do not bracket one."""

    key: CurveKey
    half: npt.NDArray[np.float64]  #: (height, width) ln units
    counting_error: npt.NDArray[np.float64]  #: (height, width) standard error of each


@dataclass(frozen=True, slots=True)
class Analysis:
    """Everything that analysis found in one run."""

    run_id: str
    title: str
    responses: tuple[ResponseRow, ...]
    curves: tuple[SCurve, ...]
    background: tuple[BackgroundRow, ...]
    pixel_maps: tuple[PixelMap, ...]
    event_map: npt.NDArray[np.int64]  #: (height, width) events of the whole run, of the window
    event_map_origin: tuple[int, int]  #: x, y of its first pixel, in sensor coordinates
    warnings: tuple[str, ...]
    damaged: tuple[str, ...] = ()  #: a line for each point that was taken, but whose file cannot be read
