"""What a slow photoreceptor still sees of the reset pulse when a pixel memorises its reference.

At the end of a reset pulse the signal falls back to the baseline. Once it has fallen by the opposite threshold the
pixel fires, and at the end of its dead time it memorises the signal as it then is. If the photoreceptor is slow, that
is not the baseline yet, and the threshold seems higher by what is left. While more is left than the opposite
threshold the pixel fires again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.characterize.slow_step import reached

if TYPE_CHECKING:
    from bench.characterize.levels import Reset

__all__ = ["Lags", "left_of_reset"]

_TIMES: Final = 400  # within the gap, closer together where the signal still falls fast
_LONGEST: Final = 12.0  # time constants: after that nothing is left


@dataclass(frozen=True, slots=True)
class Lags:
    """Time constants of the two low-passes between light and comparators at the baseline, s."""

    tau_s: float
    photoreceptor_s: float


def left_of_reset(reset: float, opposite: float, noise: float, lags: Lags, timing: Reset) -> float:
    """Return what is left of the reset pulse, ln, when the reference for the test pulse is memorised.

    Parameters
    ----------
    reset
        The signal of the reset pulse, ln, beside dark light; it had settled.
    opposite
        Threshold of the polarity that its end fires, ln.
    noise
        Of the signal, rms, ln; it lets a pixel fire before the mean has fallen far enough.
    timing
        Gap and dead time.
    """
    slowest = max(lags.tau_s, lags.photoreceptor_s)
    end = min(timing.gap_s, _LONGEST * slowest + timing.dead_s)
    time = end * np.linspace(0.0, 1.0, _TIMES) ** 2
    signal = reset * (1.0 - reached(time / lags.tau_s, np.asarray(lags.photoreceptor_s / lags.tau_s)))
    memorised, at_s = reset, 0.0
    while memorised > opposite:
        fired = _when_down_to(memorised - opposite, time, signal, noise, lags.tau_s)
        at_s = max(fired, at_s) + timing.dead_s
        if fired > end or at_s > timing.gap_s:
            break
        memorised = float(np.interp(at_s, time, signal))
    return memorised if memorised < opposite else 0.0


def _when_down_to(
    level: float, time: np.ndarray[tuple[int], np.dtype[np.float64]],
    signal: np.ndarray[tuple[int], np.dtype[np.float64]], noise: float, tau_s: float,
) -> float:  # fmt: skip
    """Return when half of the pixels have fired, whose mean signal falls to a level.

    Noise behind a low-pass crosses a barrier b rms away b phi(b) times in a tau; while the mean comes nearer by v rms
    in a tau, the crossings until b add up to phi(b) / v, which is ln 2 when half of the pixels have fired.
    """
    at = float(np.interp(-level, -signal, time))
    speed = float(np.interp(at, time[1:], -np.diff(signal) / np.diff(time))) * tau_s / noise
    crossings = math.sqrt(2.0 * math.pi) * math.log(2.0) * max(speed, 1e-12)
    early = math.sqrt(-2.0 * math.log(crossings)) if crossings < 1.0 else 0.0
    return float(np.interp(-(level + early * noise), -signal, time))
