"""Each pixel's own threshold, and how far they are apart without the noise of counting."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bench.analysis.results import Estimate
from bench.characterize.normal import Z90
from bench.characterize.result import Mismatch

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.analysis.results import PixelMap
    from bench.characterize.result import FamilyResult

__all__ = ["mismatch_of"]


def mismatch_of(family: FamilyResult, maps: Sequence[PixelMap]) -> Mismatch | None:
    """Return the mismatch of a family from the maps of its run.

    The map is that of its brightest curve, where dark light does not matter. A pixel's own threshold is its 50 %
    point, moved by as much as the mean of all is from the threshold of the fit: what noise does to the 50 % point it
    does to that of every pixel.
    """
    brightest = max(family.levels, key=lambda level: level.baseline_lux).baseline_lux
    mine = [m for m in maps if _belongs(m, family) and m.key.baseline_lux == brightest]
    if not mine:
        return None
    half, error = mine[0].half, mine[0].counting_error
    known = np.isfinite(half)
    if np.count_nonzero(known) < 2:
        return None
    theta = half + (family.theta.value - float(half[known].mean()))
    spread = math.sqrt(max(float(half[known].var(ddof=1) - np.mean(error[known] ** 2)), 0.0))
    return Mismatch(family.polarity, _sigma(family, spread, half[known]), theta, error, brightest, spread)


def _belongs(one: PixelMap, family: FamilyResult) -> bool:
    key = one.key
    return (key.polarity, key.waveform, key.pulse_width_s, key.settings) == (
        family.polarity, family.waveform, family.pulse_width_s, family.settings,
    )  # fmt: skip


def _sigma(family: FamilyResult, spread: float, half: npt.NDArray[np.float64]) -> Estimate:
    """Return the spread of the thresholds: of the fit, else of the map."""
    if family.fit is not None and "mismatch2" in family.fit.free:
        square, reach = family.fit.family.mismatch2, Z90 * family.fit.sd("mismatch2")
    else:
        square = spread**2
        total2 = float(half.var(ddof=1))
        reach = Z90 * total2 * math.sqrt(2.0 / (half.size - 1))
    low, value, high = (math.sqrt(max(v, 0.0)) for v in (square - reach, square, square + reach))
    return Estimate(value, low, high, "ln", "none seen" if low == 0.0 else "")
