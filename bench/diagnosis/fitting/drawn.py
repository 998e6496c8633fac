"""What a sensor of so many pixels can tell of the kind that it is of: its pixels are drawn from a law once.

However well the share of hot pixels of a sensor is known, another sensor of its kind has another one; so it is with
the spread of thresholds, and with their mean where they spread. Few simulated sensors do not tell how much.

Source: variances of a share, of a mean and of the standard deviation of n normal numbers; M. G. Kendall, A. Stuart,
"The advanced theory of statistics", vol. 1.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.parameters import Free
    from bench.diagnosis.expected.problem import Slot

    Floats = npt.NDArray[np.float64]

__all__ = ["drawn_variance", "is_share", "share_interval"]

#: Variance of a number of an effect beside that of one pixel: of a standard deviation.
_LAWS: Final[dict[tuple[str, str], Callable[[float], float]]] = {
    ("threshold_mismatch", "sigma_on"): lambda sigma: 0.5 * sigma**2,
    ("threshold_mismatch", "sigma_off"): lambda sigma: 0.5 * sigma**2,
    ("refractory_mismatch", "spread"): lambda sigma: 0.5 * sigma**2,
    ("dark_current", "spread"): lambda sigma: 0.5 * sigma**2,
    ("leak", "spread"): lambda sigma: 0.5 * sigma**2,
}
#: Shares of the pixels: of few of them the law is not that of a normal number.
_SHARES: Final = frozenset({("hot_pixels", "fraction")})
#: Numbers that are means, or medians, the spread that makes them so, and whether that one is relative to them.
_MEANS: Final[dict[tuple[str, str], tuple[tuple[str, str], bool]]] = {
    ("thresholds", "on"): (("threshold_mismatch", "sigma_on"), False),
    ("thresholds", "off"): (("threshold_mismatch", "sigma_off"), False),
    ("refractory_period", "period_s"): (("refractory_mismatch", "spread"), True),
    ("dark_current", "mean_fa"): (("dark_current", "spread"), True),
    ("leak", "rate_per_s"): (("leak", "spread"), True),
}


def drawn_variance(slots: Sequence[Slot], x: Floats, pixels: int) -> Floats:
    """Return (k,) the variance of each coordinate from sensor to sensor.

    Parameters
    ----------
    slots, x
        (k,) what the coordinates are of, and where they are.
    pixels
        How many pixels were measured.
    """
    values = [slot.free.value(float(at)) for slot, at in zip(slots, x, strict=True)]
    spreads = {(slot.free.owner, slot.free.name): value for slot, value in zip(slots, values, strict=True)}
    each = [_of_a_pixel(slot.free, value, spreads) for slot, value in zip(slots, values, strict=True)]
    return np.array(each) / pixels


def is_share(free: Free) -> bool:
    """Return whether a number is a share of the pixels."""
    return (free.owner, free.name) in _SHARES


def share_interval(share: float, sd: float, pixels: int, z: float) -> tuple[float, float]:
    """Return the shares from which a sensor's own is no more than `z` standard errors away.

    Parameters
    ----------
    share, sd
        Of this sensor, and how well that is known.
    pixels
        How many it has.

    Notes
    -----
    It solves ``(p - share)^2 = z^2 (p (1 - p) / pixels + sd^2)``. Source: E. B. Wilson, "Probable inference, the law
    of succession, and statistical inference", J. Am. Stat. Assoc. 22 (1927), for `sd` = 0.
    """
    a, b, c = 1.0 + z * z / pixels, share + 0.5 * z * z / pixels, share * share - (z * sd) ** 2
    half = math.sqrt(max(b * b - a * c, 0.0))
    return max((b - half) / a, 0.0), min((b + half) / a, 1.0)


def _of_a_pixel(free: Free, value: float, spreads: Mapping[tuple[str, str], float]) -> float:
    key = free.owner, free.name
    if key in _LAWS:
        variance = _LAWS[key](value)
    elif key in _MEANS:
        spread, relative = _MEANS[key]
        variance = (spreads.get(spread, 0.0) * (value if relative else 1.0)) ** 2
    else:
        return 0.0
    return variance * _slope(free, value) ** 2


def _slope(free: Free, value: float) -> float:
    """Return the derivative of the coordinate by the value."""
    if free.scale == "log":
        return 1.0 / value
    return 2.0 * value if free.scale == "square" else 1.0
