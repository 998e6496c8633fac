"""How likely differences as large as these are, if two recordings have one distribution: exact, for any distribution.

A pixel has the same frozen differences in both recordings, so they are compared pixel by pixel. If both have one
distribution, a pixel's difference is as likely as its negative, independently of all other pixels: every choice of
signs is as likely as the one that was seen. What the pulses of a pixel have to do with each other does not matter.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

__all__ = ["holm", "sign_flip_p_values"]

#: Choices of signs that are drawn first, in all for what is rare among these, and at a time.
_FIRST: Final = 2000
_ALL: Final = 200_000
_BATCH: Final = 2000
#: Fewer choices than this with as large a difference are rare.
_RARE: Final = 40
#: Single precision: a difference this much smaller counts as being as large.
_TIE: Final = 1e-5


def sign_flip_p_values(differences: Mapping[str, Floats], seed: int = 0) -> dict[str, float]:
    """Return the p-value of each set of differences.

    The statistic of a set is the largest of its columns' |sum| / sqrt(sum of squares). Where so few choices of signs
    reach it that drawing them tells nothing, the p-value is the bound 2 columns exp(-statistic^2 / 2).

    Parameters
    ----------
    differences
        (n, columns) of each of n independent units, for each set; all have the same n.
    seed
        Of the signs.

    Sources: R. A. Fisher, "The design of experiments" (1935), on choices of signs; the bound is W. Hoeffding,
    "Probability inequalities for sums of bounded random variables", Journal of the American Statistical Association
    58 (1963).
    """
    rng = np.random.default_rng(seed)
    unit = {name: _of_unit_length(np.asarray(d, np.float64)) for name, d in differences.items()}
    seen = {name: float(np.abs(d.sum(axis=0)).max()) for name, d in unit.items()}
    bound = {name: 2.0 * d.shape[1] * math.exp(-0.5 * seen[name] ** 2) for name, d in unit.items()}
    found = {name: p for name, p in bound.items() if p < 1.0 / (_ALL + 1)}
    counted = {name: d for name, d in unit.items() if name not in found}
    reached = _count(counted, seen, _FIRST, rng)
    found |= {name: (1 + count) / (_FIRST + 1) for name, count in reached.items()}
    rare = {name: d for name, d in counted.items() if reached[name] < _RARE}
    more = _count(rare, seen, _ALL - _FIRST, rng)
    found |= {name: (1 + reached[name] + more[name]) / (_ALL + 1) for name in rare}
    return {name: found[name] for name in differences}


def _of_unit_length(differences: Floats) -> Floats:
    """Return the columns over their lengths; a column of zeros stays."""
    length = np.sqrt(np.sum(differences**2, axis=0))
    return differences / np.where(length > 0.0, length, 1.0)


def _count(
    unit: Mapping[str, Floats], seen: Mapping[str, float], draws: int, rng: np.random.Generator
) -> dict[str, int]:
    """Return how many of some random choices of signs give a statistic as large as the one that was seen."""
    if not unit:
        return {}
    columns = np.hstack(list(unit.values())).astype(np.float32)
    begins = np.cumsum([0, *(d.shape[1] for d in unit.values())])[:-1]
    least = (1.0 - _TIE) * np.array([seen[name] for name in unit])
    count = np.zeros(len(unit), np.int64)
    for first in range(0, draws, _BATCH):
        batch = min(_BATCH, draws - first)
        bits = np.unpackbits(rng.integers(0, 256, (batch, math.ceil(len(columns) / 8)), np.uint8), axis=1)
        sums = np.abs((1.0 - 2.0 * bits[:, : len(columns)].astype(np.float32)) @ columns)
        count += np.sum(np.maximum.reduceat(sums, begins, axis=1) >= least, axis=0)
    return dict(zip(unit, count.tolist(), strict=True))


def holm(p_values: Mapping[str, float]) -> dict[str, float]:
    """Return p-values corrected for their number; the family errs no more often than each of them says.

    Source: S. Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 6
    (1979).
    """
    corrected = {}
    largest = 0.0
    for i, name in enumerate(sorted(p_values, key=lambda n: p_values[n])):
        largest = max(largest, min(1.0, (len(p_values) - i) * p_values[name]))
        corrected[name] = largest
    return corrected
