"""How large a step of the light must be near the dark limit, and the dark light that follows from it.

Behind the logarithm a step of the light E by the factor r changes the signal by ``ln((E r + E_d) / (E + E_d))``; E_d,
the equivalent dark illuminance, is light that is not modulated: dark current divided by the photocurrent of one lux,
or stray light. Where that change is the threshold theta,

    r = e^theta + (e^theta - 1) E_d / E,        E_d = E (r - e^theta) / (e^theta - 1)

(the paper's equation for the dark current, in lux). Written with the **Weber contrast** ``W = |r - 1|``, the step as
a part of the level that it starts from, this is a straight line in 1/E, for both polarities:

    W = w (1 + E_d / E),        w = |e^(+-theta) - 1|
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bench.analysis.results import ResponsePolarity

__all__ = ["contrast_needed", "dark_light", "signal_of", "threshold_of", "weber"]


def weber(log_contrast: float, polarity: ResponsePolarity) -> float:
    """Return the size of a step as a part of the level that it starts from.

    Parameters
    ----------
    log_contrast
        ln(E_max / E_min), 0 or above.
    polarity
        ``on``: the step goes up; ``off``: it goes down, and W stays below 1.
    """
    return math.expm1(log_contrast) if polarity == "on" else -math.expm1(-log_contrast)


def threshold_of(weber_contrast: float, polarity: ResponsePolarity) -> float:
    """Return the log contrast of a Weber contrast; infinite for a step down to nothing, or below."""
    if polarity == "on":
        return math.log1p(weber_contrast)
    return -math.log1p(-weber_contrast) if weber_contrast < 1.0 else math.inf


def signal_of(log_contrast: float, baseline_lux: float, dark_lux: float, polarity: ResponsePolarity) -> float:
    """Return by how much a step changes the logarithm of the photocurrent, ln units, as a positive number.

    Examples
    --------
    >>> round(signal_of(0.800, 0.076, 0.14626, "on"), 4)
    0.35
    """
    return threshold_of(weber(log_contrast, polarity) * baseline_lux / (baseline_lux + dark_lux), polarity)


def contrast_needed(theta: float, baseline_lux: float, dark_lux: float, polarity: ResponsePolarity) -> float:
    """Return the log contrast at which the signal changes by `theta`.

    Infinite for OFF where even darkness is no step that large: below ``E_d (e^theta - 1)``.

    Examples
    --------
    >>> round(contrast_needed(0.35, 0.304, 0.14626, "on"), 3)
    0.483
    """
    return threshold_of(weber(theta, polarity) * (1.0 + dark_lux / baseline_lux), polarity)


def dark_light(log_contrast: float, baseline_lux: float, theta: float, polarity: ResponsePolarity = "on") -> float:
    """Return the equivalent dark illuminance, lux, under which a step of this contrast just reaches a threshold.

    Negative where the contrast is below the threshold: chance, or an error of one of the two.

    Examples
    --------
    >>> round(dark_light(0.8, 0.076, 0.35), 4)
    0.1463
    """
    return baseline_lux * (weber(log_contrast, polarity) / weber(theta, polarity) - 1.0)
