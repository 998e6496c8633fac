"""Normal equations, whatever the units of the coordinates.

One over a rate is 1e-6 s, known to 1e-9 s, and the logarithm of a threshold is known to 1e-3: what is left of the one
beside the other would be taken for nothing by any threshold on singular values.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

__all__ = ["inverse", "solved", "units"]

#: Of a direction with less information, beside that of its coordinates by themselves, nothing is known; and neither
#: of the coordinates that have such a part in it.
_NO_DIRECTION: Final = 1e-9
_PART_OF: Final = 1e-3
#: What is less beside the largest is no direction at all.
_NOTHING: Final = 1e-10


def units(products: Floats) -> tuple[Floats, Floats]:
    """Return the lengths (k,) of columns, of their products with each other (k, k), and one over them; or zero."""
    length = np.sqrt(np.maximum(np.diag(products), 0.0))
    return length, np.where(length > 0.0, 1.0 / np.where(length > 0.0, length, 1.0), 0.0)


def solved(left: Floats, right: Floats) -> Floats:
    """Return the least-squares solution (k, ...) of ``left x = right``; `left` (k, k) is symmetric."""
    unit = units(left)[1]
    return (unit * np.linalg.lstsq(left * np.outer(unit, unit), (unit * right.T).T, rcond=_NOTHING)[0].T).T


def inverse(information: Floats) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Return the covariance (k, k), and of which coordinates (k,) nothing is known."""
    unit = units(information)[1]
    values, vectors = np.linalg.eigh(information * np.outer(unit, unit))
    kept = values > _NO_DIRECTION
    found = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T * np.outer(unit, unit)
    return found, np.sum(vectors[:, ~kept] ** 2, axis=1) > _PART_OF
