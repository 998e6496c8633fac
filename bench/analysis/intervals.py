"""Intervals of shares and rates that count pixels, not pulses or events, as independent.

The pulses of one pixel share its frozen threshold, and the events of a hot pixel its defect. An interval that counts
each of them as independent would be too narrow.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["COVERAGE", "poisson_interval", "rate_interval", "share_interval"]

COVERAGE: Final = 0.90
_TAIL: Final = 0.5 * (1.0 - COVERAGE)


def share_interval(answers: npt.NDArray[np.integer], trials: npt.NDArray[np.int64]) -> tuple[float, float, float]:
    """Return a share with its 90 % interval, from the answers of each pixel.

    The variance between pixels gives an effective number of independent trials, at least one and at most `trials`
    per pixel; with it the interval is Wilson's, with Student's quantile for the number of pixels. Where no pixel, or
    every pixel, always answered, the variance says nothing, and each pixel counts as one trial.

    Parameters
    ----------
    answers, trials
        (pixels,) answers of each pixel, and how often it was asked; a pixel that was never asked does not count.

    Returns
    -------
    share, low, high
        NaN, 0 and 1 without any trial.
    """
    asked = trials > 0
    k, n = answers[asked].astype(np.float64), trials[asked].astype(np.float64)
    if not n.size:
        return float("nan"), 0.0, 1.0
    share = float(k.sum() / n.sum())
    if n.size == 1:
        return share, 0.0, 1.0
    return share, *_wilson(share, _effective_trials(share, k, n), _student(n.size - 1))


def _effective_trials(share: float, k: npt.NDArray[np.float64], n: npt.NDArray[np.float64]) -> float:
    if share in (0.0, 1.0):
        return float(n.size)
    variance = n.size / (n.size - 1.0) * float(np.sum((k - share * n) ** 2)) / float(n.sum()) ** 2
    independent = share * (1.0 - share) / variance if variance > 0.0 else np.inf
    return float(min(max(independent, n.size), n.sum()))


def _student(freedom: int) -> float:
    from scipy.special import stdtrit

    return float(stdtrit(freedom, 1.0 - _TAIL))


def _wilson(share: float, n: float, z: float) -> tuple[float, float]:
    centre = (share + z * z / (2.0 * n)) / (1.0 + z * z / n)
    half = z / (1.0 + z * z / n) * np.sqrt(share * (1.0 - share) / n + z * z / (4.0 * n * n))
    low = 0.0 if share == 0.0 else max(float(centre - half), 0.0)
    return low, 1.0 if share == 1.0 else min(float(centre + half), 1.0)


def poisson_interval(events: float) -> tuple[float, float]:
    """Return the exact 90 % interval of a Poisson mean (Garwood 1936) from a count, whole or effective."""
    from scipy.special import gammaincinv

    low = float(gammaincinv(events, _TAIL)) if events > 0.0 else 0.0
    return low, float(gammaincinv(events + 1.0, 1.0 - _TAIL))


def rate_interval(events: npt.NDArray[np.int64], seconds: float) -> tuple[float, float, float]:
    """Return the mean rate of pixels in Hz with its 90 % interval, from the events of each pixel.

    The variance between pixels gives an effective number of independent events, never more than there are: with
    Poisson counts the interval is the exact one, and hot pixels or bursts widen it. Without events the upper end is
    an upper limit.

    Parameters
    ----------
    events
        (pixels,) events of each pixel.
    seconds
        Length of the recording.
    """
    pixels, total = events.size, float(events.sum())
    exposure = pixels * seconds
    if not exposure > 0.0:
        return float("nan"), 0.0, float("nan")
    effective = total
    if pixels > 1 and total > 0.0:
        spread = pixels * float(np.var(events, ddof=1))
        effective = min(total, total * total / spread) if spread > 0.0 else total
    low, high = poisson_interval(effective)
    scale = total / effective / exposure if total > 0.0 else 1.0 / exposure
    return total / exposure, low * scale, high * scale
