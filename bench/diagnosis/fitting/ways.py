"""Along which directions, and how far, to look how what is expected changes: all of them about equally well seen.

What little effort tells on the way to a minimum may be wrong by far: a number of which it shows nothing would be
moved by hundreds of standard errors, where lines are long bent. So it is looked how far statistics move in truth, and
the directions are set right until they move as far as wanted.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.parameters import ALIGNMENT
from bench.diagnosis.fitting import robust
from bench.diagnosis.fitting.fitted import prior_precision, whiten
from bench.diagnosis.fitting.slopes import samples_around, slopes
from bench.diagnosis.fitting.steps import longest_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.problem import Problem, Slot
    from bench.diagnosis.expected.residuals import Expectation
    from bench.diagnosis.fitting.slopes import Sample
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]

__all__ = ["directions", "well_seen"]

#: All statistics together move by so many standard errors, to either side, if that is no more than a share of the
#: longest step: chance is small beside that, and lines are straight.
_MOVED: Final = 60.0
_FARTHEST: Final = 0.3
#: Directions are set right until they are that no more, by this factor, at the most so often; with this effort.
_ABOUT: Final = 2.0
_ROUNDS: Final = 4
_LITTLE: Final = 0.3
_OTHER_SEED: Final = 101


def directions(slots: Sequence[Slot], at: Floats, information: Floats) -> Floats:
    """Return (k, m) directions in the columns, as long as statistics are to move along them.

    What a time offset takes up of a move does not count: it is known to the letter what an offset does, and a valley
    between it and other numbers is as well seen as they are only where one has gone along it far enough.

    Parameters
    ----------
    at
        (k,) coordinates.
    information
        (k, k) about them, in all statistics.
    """
    simulated = np.array([slot.free.owner != ALIGNMENT for slot in slots])
    scale = longest_of(slots, at)[simulated]
    known = information + np.diag(prior_precision(slots))
    values, vectors = np.linalg.eigh(_without_others(known, simulated) * np.outer(scale, scale))
    far = np.minimum(_MOVED / np.sqrt(np.maximum(values, _MOVED**2 * 1e-6)), _FARTHEST)
    found = np.zeros((len(slots), len(scale)))
    found[simulated] = scale[:, None] * vectors * far
    return found


def _without_others(information: Floats, mine: npt.NDArray[np.bool_]) -> Floats:
    """Return the information about some coordinates once the others have followed (Schur complement)."""
    mixed = information[np.ix_(mine, ~mine)]
    others = np.linalg.pinv(information[np.ix_(~mine, ~mine)], hermitian=True)
    return np.asarray(information[np.ix_(mine, mine)] - mixed @ others @ mixed.T)


def well_seen(
    problem: Problem, model: PixelModel, slots: Sequence[Slot], at: Floats, here: Expectation, information: Floats,
    seed: int,
) -> Floats:  # fmt: skip
    """Return the same, such that statistics do move as far as wanted.

    Parameters
    ----------
    here
        What is expected there.
    information
        (k, k) roughly.
    """
    ways = directions(slots, at, information)
    samples: list[Sample] = []
    for number in range(_ROUNDS):
        fresh = samples_around(problem, model, slots, at, seed + _OTHER_SEED * number, ways, _LITTLE)
        samples += [replace(one, pair=one.pair + number * ways.shape[1]) for one in fresh]
        sides = (
            whiten(here.roots, j, problem.measured.points) for j in slopes(problem, slots, at, here, samples, ways)
        )
        changes, chance = robust.mean_and_chance(*sides)
        before, ways = ways, directions(slots, at, robust.without(changes.T @ changes, chance.T @ chance))
        longer = np.linalg.svd(np.linalg.pinv(before) @ ways, compute_uv=False)
        if longer.max() < _ABOUT and longer.min() > 1.0 / _ABOUT:
            break
    return ways
