"""The stationary law of a linear, noisy system in discrete time: where a recording starts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

__all__ = ["draw", "stationary_covariance"]

#: A variance this much smaller than the largest of its system counts as 0.
_NO_VARIANCE = 1e-14


def stationary_covariance(transition: Floats, noise: Floats) -> Floats:
    """Return the covariance P of ``x <- A x + B z`` in the long run: ``P = A P A^T + B B^T``.

    Parameters
    ----------
    transition
        (n, k, k) A of n systems, all eigenvalues within the unit circle.
    noise
        (n, k, m) B.

    Returns
    -------
    (n, k, k) P.
    """
    n, k, _ = transition.shape
    both = np.einsum("nij,nkl->nikjl", transition, transition).reshape(n, k * k, k * k)
    added = (noise @ noise.transpose(0, 2, 1)).reshape(n, k * k, 1)
    return np.asarray(np.linalg.solve(np.eye(k * k) - both, added).reshape(n, k, k))


def draw(covariance: Floats, z: Floats) -> Floats:
    """Return Gaussian vectors of this covariance, (k, n), made of standard normal numbers `z`, (k, n).

    The first component is its standard deviation times the first number. A component without variance is 0.
    """
    n, k, _ = covariance.shape
    floor = _NO_VARIANCE * np.max(np.einsum("nii->ni", covariance), axis=1)
    lower = np.zeros((n, k, k))
    for j in range(k):
        rest = covariance[:, :, j] - np.einsum("nil,nl->ni", lower[:, :, :j], lower[:, j, :j])
        pivot = np.where(rest[:, j] > floor, rest[:, j], np.inf)
        lower[:, j:, j] = rest[:, j:] / np.sqrt(pivot)[:, None]
    return np.asarray(np.einsum("nij,jn->in", lower, z))
