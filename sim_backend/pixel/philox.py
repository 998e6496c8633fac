"""The counter-based generator Philox4x32-10 in NumPy, for numbers that are drawn once.

Any number of the sequence can be had from its address (key, counter) alone, so a pixel's numbers do not depend on
which other pixels are simulated. The engines have their own compiled form; both give the same words.

Source: J. K. Salmon, M. A. Moraes, R. O. Dror, D. E. Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC11
(2011).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["normals", "philox4x32", "split_seed", "uniforms"]

_ROUNDS: Final = 10
_MULTIPLIER: Final = (np.uint64(0xD2511F53), np.uint64(0xCD9E8D57))
_WEYL: Final = (0x9E3779B9, 0xBB67AE85)
_LOW: Final = np.uint64(0xFFFFFFFF)
_HALF: Final = np.uint64(32)


def split_seed(seed: int) -> tuple[int, int]:
    """Return the two 32-bit words of the key that belongs to `seed`, 0 to 2^64 - 1."""
    if not 0 <= seed < 1 << 64:
        raise ValueError(f"seed is {seed}; expected a whole number from 0 to 2^64 - 1")
    return seed & 0xFFFFFFFF, seed >> 32


def philox4x32(counter: npt.NDArray[np.uint32], key: tuple[int, int]) -> npt.NDArray[np.uint32]:
    """Return the four random words of each counter.

    Parameters
    ----------
    counter
        (n, 4) words.
    key
        Two words of 32 bits.

    Returns
    -------
    (n, 4) words.
    """
    c0, c1, c2, c3 = (counter[:, i].astype(np.uint64) for i in range(4))
    for i in range(_ROUNDS):
        k0, k1 = (np.uint64((k + i * w) & 0xFFFFFFFF) for k, w in zip(key, _WEYL, strict=True))
        p0, p1 = _MULTIPLIER[0] * c0, _MULTIPLIER[1] * c2
        c0, c1, c2, c3 = (p1 >> _HALF) ^ c1 ^ k0, p1 & _LOW, (p0 >> _HALF) ^ c3 ^ k1, p0 & _LOW
    return np.stack([c0, c1, c2, c3], axis=1).astype(np.uint32)


def normals(seed: int, index: npt.NDArray[np.uint32], purpose: int) -> npt.NDArray[np.float64]:
    """Return one standard normal number for each of `index`, (n,); another `purpose` gives independent ones.

    Box-Muller on two 53-bit uniform numbers made of the four words at counter (index, purpose, 0, 0).
    """
    words = _words(seed, index, purpose)
    radius = np.sqrt(-2.0 * np.log1p(-_uniform(words[:, 0], words[:, 1])))
    return radius * np.cos(2.0 * np.pi * _uniform(words[:, 2], words[:, 3]))


def uniforms(seed: int, index: npt.NDArray[np.uint32], purpose: int) -> npt.NDArray[np.float64]:
    """Return one number from 0 to below 1 for each of `index`, (n,); another `purpose` gives independent ones."""
    words = _words(seed, index, purpose)
    return _uniform(words[:, 0], words[:, 1])


def _words(seed: int, index: npt.NDArray[np.uint32], purpose: int) -> npt.NDArray[np.uint32]:
    """Return the (n, 4) random words at the counters (index, purpose, 0, 0)."""
    counter = np.zeros((len(index), 4), np.uint32)
    counter[:, 0] = index
    counter[:, 1] = purpose
    return philox4x32(counter, split_seed(seed))


def _uniform(high: npt.NDArray[np.uint32], low: npt.NDArray[np.uint32]) -> npt.NDArray[np.float64]:
    """Return numbers in [0, 1) of 53 bits."""
    return (high.astype(np.float64) * 2.0**21 + (low >> np.uint32(11))) * 2.0**-53
