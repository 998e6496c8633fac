"""Each pixel's own 50 % point, with its counting error.

All pixels of a curve are taken to share floor, plateau and the width of their own transition (their noise); only the
centre differs. The width is the one under which the answers of all pixels are most likely. A pixel's 50 % point and
error are the mean and standard deviation of its likelihood over the range of the contrasts: where the answers form a
bare step between two contrasts, that is their middle, and their distance over the square root of 12.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.results import PixelMap

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.analysis.results import CurveKey
    from bench.analysis.scurve import CurveCounts
    from protocols.points import Roi

    Floats = npt.NDArray[np.float64]

__all__ = ["pixel_map"]

_CENTRES: Final = 301
_WIDTHS: Final = 24
_BLOCK: Final = 8192  # pixels at a time
_WIDTH_PIXELS: Final = 4096  # pixels that choose the width
_FLOOR_LEAST: Final = 1e-4  # one stray answer must not rule a pixel's threshold out


def pixel_map(key: CurveKey, counts: CurveCounts, floor: float, plateau: float, roi: Roi) -> PixelMap:
    """Return the map of one curve.

    Parameters
    ----------
    floor, plateau
        Those of the whole curve.
    roi
        Window of pixels that `counts` covers, row by row.
    """
    floor = max(floor, _FLOOR_LEAST)
    plateau = max(min(plateau, 1.0 - _FLOOR_LEAST), floor + _FLOOR_LEAST)
    x = counts.log_contrast
    centres = np.linspace(x[0], x[-1], _CENTRES)
    curves = _curves(_width(counts, centres, floor, plateau), x, centres, floor, plateau)
    half = np.full(counts.answers.shape[1], np.nan)
    error = np.full(half.size, np.nan)
    for start in range(0, half.size, _BLOCK):
        block = slice(start, start + _BLOCK)
        weight, _ = _likelihood(counts.answers[:, block], counts.trials[:, block], curves)
        half[block] = weight @ centres
        error[block] = np.sqrt(np.maximum(weight @ centres**2 - half[block] ** 2, 0.0))
    unknown = ~_bracketed(counts, floor, plateau)
    half[unknown] = error[unknown] = np.nan
    shape = (roi.height, roi.width)
    return PixelMap(key, half.reshape(shape), error.reshape(shape))


def _bracketed(counts: CurveCounts, floor: float, plateau: float) -> npt.NDArray[np.bool_]:
    """Return (pixels,) whether the answers are below the middle at first and above it at last."""
    middle = 0.5 * (floor + plateau)
    asked = counts.trials.all(axis=0)
    share = counts.answers[[0, -1]] / np.maximum(counts.trials[[0, -1]], 1)
    return np.asarray(asked & (share[0] < middle) & (share[1] > middle))


def _curves(width: float, x: Floats, centres: Floats, floor: float, plateau: float) -> Floats:
    """Return (n, centres) probabilities of an answer."""
    from scipy.special import ndtr

    return np.asarray(floor + (plateau - floor) * ndtr((x[:, None] - centres) / width), np.float64)


def _likelihood(
    answers: npt.NDArray[np.int64], trials: npt.NDArray[np.int64], curves: Floats
) -> tuple[Floats, Floats]:
    """Return (pixels, centres) likelihoods that sum to one for each pixel, and (pixels,) ln of their sums."""
    log = answers.T @ np.log(curves) + (trials - answers).T @ np.log1p(-curves)
    highest = log.max(axis=1, keepdims=True)
    likelihood = np.exp(log - highest)
    total = likelihood.sum(axis=1, keepdims=True)
    return likelihood / total, (highest + np.log(total))[:, 0]


def _width(counts: CurveCounts, centres: Floats, floor: float, plateau: float) -> float:
    """Return the width of one pixel's transition under which the answers of the pixels are most likely."""
    x = counts.log_contrast
    asked = np.flatnonzero(counts.trials.all(axis=0))
    if asked.size > _WIDTH_PIXELS:
        asked = np.random.default_rng(0).choice(asked, _WIDTH_PIXELS, replace=False)
    answers, trials = counts.answers[:, asked], counts.trials[:, asked]
    narrowest = 0.02 * float(np.min(np.diff(x)))
    widths = np.geomspace(narrowest, 0.5 * float(x[-1] - x[0]), _WIDTHS)
    fit = [_likelihood(answers, trials, _curves(w, x, centres, floor, plateau))[1].sum() for w in widths]
    return float(widths[int(np.argmax(fit))])
