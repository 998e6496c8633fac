"""The phase of a ripple in each recording, from all that a fitted model lets expect of the recording at each phase.

What events do beyond the stimulus tells a phase as soon as they are seen, see :mod:`bench.diagnosis.phases`. But that
wants a model that answers as the pixels do, and nothing is seen so of a ripple that comes at nearly the same phase of
every pulse: then latencies and probabilities have it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis import robust
from bench.diagnosis.looks import shifted

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.diagnosis.fitted import Fit
    from bench.diagnosis.problem import Problem

    Floats = npt.NDArray[np.float64]

__all__ = ["sharper_phases"]

#: Phases that are simulated, and those that are looked at between them.
_SIMULATED: Final = 8
_LOOKED_AT: Final = 64
#: Harmonics of the phase in what is expected: half of what is done at all of them is chance.
_HARMONICS: Final = 2
#: A recording has another phase when its loss falls by more than chance lets one number fall.
_CHANCE: Final = 4.0
#: Points of one law are simulated once, but the ripple of each is seen at a phase of its own: so their models differ.
_TELLS_APART: Final = 1e-6


def sharper_phases(problem: Problem, fitted: Fit, seed: int) -> list[float | None]:
    """Return the phase of the ripple in each recording, rad from 0 to 2 pi; the one it had where none is better.

    Parameters
    ----------
    fitted
        A model with a ripple whose phase is open.
    """
    apart = [_TELLS_APART * i for i in range(len(problem.points))]
    at = 2.0 * math.pi * np.arange(_SIMULATED) / _SIMULATED
    turned = [replace(problem, phases=tuple(float(phase) + more for more in apart)) for phase in at]
    models = [one.models(fitted.model, fitted.slots, fitted.x) for one in turned]
    seen = [
        shifted(problem, problem.expect(sensors), fitted.slots, fitted.x)
        for sensors in problem.forward.run(models, seed)
    ]
    values = np.stack([e.value for e in seen])
    fine = 2.0 * math.pi * np.arange(_LOOKED_AT) / _LOOKED_AT
    between = _harmonics(fine) @ np.linalg.lstsq(_harmonics(at), values, rcond=None)[0]
    found = list(problem.phases)
    for i, where in enumerate(problem.measured.points):
        losses = []
        for expected, phase in zip(between[:, where], fine, strict=True):
            root = seen[round(phase / (2.0 * math.pi) * _SIMULATED) % _SIMULATED].roots[i]
            losses.append(robust.loss(root @ (problem.measured.value[where] - expected)))
        known = found[i]
        before = math.inf if known is None else losses[round(known / (2.0 * math.pi) * _LOOKED_AT) % _LOOKED_AT]
        if min(losses) < before - _CHANCE:
            found[i] = float(fine[int(np.argmin(losses))])
    return found


def _harmonics(phase: Floats) -> Floats:
    turns = np.outer(phase, np.arange(1, _HARMONICS + 1))
    return np.concatenate([np.ones((len(phase), 1)), np.cos(turns), np.sin(turns)], axis=1)
