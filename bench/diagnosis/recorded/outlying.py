"""Pixels that fire on their own: how many and how often, from all recordings under constant light together."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.recorded.recording import Frame, Recording

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from bench.store.data import PointData

    Floats = npt.NDArray[np.float64]

__all__ = ["Outlying", "outlying_in", "outlying_pixels"]

#: This share of the pixels, the quietest, tells what is usual.
_FELLOWS: Final = 0.9
#: Chance that any pixel of a sensor without outlying ones counts as one.
_CHANCE: Final = 0.01
#: It sends at least so many times as many: what differs from pixel to pixel otherwise hardly goes so far.
_TIMES: Final = 4.0
#: How many pixels are outlying is known no better than to this part of one.
_OF_A_PIXEL: Final = 0.25
#: Steps for second derivatives, in the logarithms and the logit that are fitted.
_STEP: Final = 0.02
#: A likelihood that is less curved is flat: one of these is known to three units at best.
_FLAT: Final = 0.1
_LARGEST: Final = 50.0
#: Two kinds of pixels are clearer than one when the logarithm of the likelihood is larger by this: 4.6 comes by
#: chance once in a hundred, with two numbers more. The other kind are few.
_CLEARER: Final = 6.0
_MOST: Final = 0.25
#: Odds of none, and fellows that are alike, to start from.
_NONE: Final = 1e-9
_ALIKE: Final = 10.0
#: Fellows that send fewer than so many events each are taken for the same.
_HARDLY: Final = 0.5
_THE_SAME: Final = 1e6


@dataclass(frozen=True, slots=True)
class Outlying:
    """Pixels that send more than their fellows."""

    fraction: float  #: share of the pixels of this sensor
    rate_hz: float  #: ON events a second that one of them sends more
    fraction_sd: float  #: standard error, of the share that this sensor has; infinite where it shows by eye alone
    log_rate_sd: float  #: standard error of the logarithm of the rate, as that


def outlying_pixels(points: Sequence[PointData]) -> Outlying | None:
    """Return how many pixels send how many ON events a second more than their fellows; None if there are none.

    A pixel is outlying when its number of events, in all recordings under constant light together, is too large for
    chance (Poisson) at the rate of its fellows. Where each sends few, none may be so for sure, and all of them
    together still are: more pairs of events are of one pixel than chance lets be. The points have to be of one
    window.
    """
    frames = [Frame(point) for point in points if point.waveform == "constant"]
    if not frames or not frames[0].pixels or len({(f.point.roi, f.rank.tobytes()) for f in frames}) != 1:
        return None
    counts: Floats = np.sum([Recording(f, f.point.events()).counts(1) for f in frames], axis=0)
    return outlying_in(counts, float(sum(f.observed_s for f in frames)))


def outlying_in(counts: Floats, seconds: float) -> Outlying | None:
    """Return the same from the number of ON events of each pixel, (n,), in some seconds under constant light."""
    share, more = _by_eye(counts)
    return _likeliest(counts, share, more, seconds) if more > 0.0 else None


def _by_eye(counts: Floats) -> tuple[float, float]:
    """Return which share of the pixels sends how many events more, about; zeros if none does."""
    from scipy.stats import poisson

    usual = float(np.sort(counts)[: max(int(_FELLOWS * counts.size), 1)].mean())
    # Where hardly any pixel sends anything, one event makes no pixel outlying.
    usual = max(usual, 1.0)
    outlying = (poisson.sf(counts - 1.0, usual) < _CHANCE / counts.size) & (counts > _TIMES * usual)
    if outlying.any():
        return float(outlying.mean()), float(counts[outlying].mean() - usual)
    more = _more_of_few(counts)
    return (float(counts.mean()) / more, more) if more > 0.0 else (0.0, 0.0)


def _more_of_few(counts: Floats) -> float:
    """Return how many events more some pixels have on average that cannot be told one by one; 0 if there are none.

    A share f of pixels with a Poisson number of mean m has f m events and f m^2 / 2 pairs of them, by pixel.
    """
    from scipy.stats import poisson

    events, pairs = float(counts.sum()), 0.5 * float(np.sum(counts * (counts - 1.0)))
    by_chance = 0.5 * events**2 / counts.size
    if float(poisson.sf(pairs - 1.0, by_chance)) > _CHANCE:
        return 0.0
    return 2.0 * (pairs - by_chance) / events


def _likeliest(counts: Floats, share: float, more: float, seconds: float) -> Outlying:
    """Return what makes the numbers of events most likely: pixels of two kinds.

    Fellows differ among themselves (negative binomial numbers); the others have a Poisson number on top. A pixel that
    may be of either kind counts for both (G. J. McLachlan, D. Peel, "Finite mixture models", 2000, ch. 2). Where
    fellows that differ more explain as much, nothing is known but what shows by eye.
    """
    from scipy.optimize import minimize

    numbers, pixels = np.unique(counts, return_counts=True)

    def loss(at: Floats) -> float:
        return -float(pixels @ np.logaddexp(*_by_kind(numbers, at)))

    def likeliest(start: Floats, free: npt.NDArray[np.bool_]) -> tuple[Floats, float]:
        at = start.copy()

        def with_free(x: Floats) -> float:
            at[free] = x
            return loss(at)

        options = {"maxiter": 4000, "xatol": 1e-4, "fatol": 1e-5}
        found = minimize(with_free, start[free], method="Nelder-Mead", options=options)
        at[free] = found.x
        return at, float(found.fun)

    usual = max(float(np.sort(counts)[: max(int(_FELLOWS * counts.size), 1)].mean()), 1e-3)
    alike = usual < _HARDLY
    start = np.log([usual, share / (1.0 - min(share, _MOST)), more, _THE_SAME if alike else _ALIKE])
    at, least = likeliest(start, np.array([True, True, True, not alike]))
    none = np.log([max(counts.mean(), 1e-3), _NONE, more, 1.0])
    is_clear = alike or likeliest(none, np.array([True, False, False, True]))[1] - least >= _CLEARER
    own, other = _by_kind(numbers, at)
    of_others = 1.0 / (1.0 + np.exp(np.clip(own - other, -_LARGEST, _LARGEST)))
    fraction, n = float(pixels @ of_others) / counts.size, counts.size
    if not is_clear or fraction > _MOST:
        return Outlying(share, more / seconds, math.inf, math.inf)
    sd = _errors(loss, at)
    law_sd = fraction * (1.0 - fraction) * float(sd[1])
    return Outlying(
        fraction=fraction,
        rate_hz=float(np.exp(at[2])) / seconds,
        # Of how well the law is known a part is how many of its pixels this sensor happens to have.
        fraction_sd=math.sqrt(max(law_sd**2 - fraction * (1.0 - fraction) / n, (_OF_A_PIXEL / n) ** 2)),
        log_rate_sd=float(sd[2]),
    )


def _by_kind(counts: Floats, at: Floats) -> tuple[Floats, Floats]:
    """Return (n,) the logarithms of the chance of each number of events, of either kind of pixel, times its share.

    Parameters
    ----------
    at
        Logarithms of the fellows' mean, of the odds of the other kind, of how many events it has more, and of how
        alike the fellows are (size of the negative binomial).
    """
    mean, odds, more, size = np.exp(np.clip(at, -_LARGEST, _LARGEST))
    size = min(max(size, 1e-3), 1e6)
    variance = mean + mean**2 / size
    # The sum of both numbers, as a negative binomial of the same mean and variance.
    of_both = min((mean + more) ** 2 / max(variance - mean, 1e-12), 1e9)
    own = _negative_binomial(counts, mean, size) - np.log1p(odds)
    other = _negative_binomial(counts, mean + more, of_both) + np.log(odds) - np.log1p(odds)
    return own, other


def _negative_binomial(counts: Floats, mean: float, size: float) -> Floats:
    """Return (n,) the logarithms of the chance of each number; scipy's own takes ten times as long to be called."""
    from scipy.special import gammaln

    known = gammaln(counts + size) - gammaln(size) - gammaln(counts + 1.0)
    return np.asarray(known + size * np.log(size / (size + mean)) + counts * np.log(mean / (size + mean)))


def _errors(loss: Callable[[Floats], float], at: Floats) -> Floats:
    """Return (k,) standard errors of the place where a negative logarithm of a likelihood is least.

    What is hardly known is left out: the curvature there is that of no minimum.
    """
    k = at.size
    steps = _STEP * np.eye(k)
    curved = np.array([[_mixed(loss, at, steps[i], steps[j]) for j in range(k)] for i in range(k)])
    values, vectors = np.linalg.eigh(curved)
    return np.asarray(np.sqrt((vectors**2 / np.maximum(values, _FLAT)).sum(axis=1)))


def _mixed(loss: Callable[[Floats], float], at: Floats, one: Floats, other: Floats) -> float:
    """Return the second derivative along two steps."""
    far, near = loss(at + one + other) + loss(at - one - other), loss(at + one - other) + loss(at - one + other)
    return (far - near) / (4.0 * _STEP**2)
