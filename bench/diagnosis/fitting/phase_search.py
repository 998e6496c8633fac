"""The phase of a ripple in each recording, from all that a fitted model lets expect of the recording at each phase.

What events do beyond the stimulus tells a phase as soon as they are seen, see :mod:`bench.diagnosis.expected.phases`.
But that wants a model that answers as the pixels do, and nothing is seen so of a ripple that comes at nearly the same
phase of every pulse: then latencies and probabilities have it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.residuals import filled
from bench.diagnosis.fitting import robust
from bench.diagnosis.fitting.explaining import explain
from bench.diagnosis.fitting.looks import shifted
from bench.diagnosis.fitting.steps import inside

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit

    Floats = npt.NDArray[np.float64]

__all__ = ["Turned", "sharper_phases"]

#: Phases that are simulated, and those that are looked at between them.
_SIMULATED: Final = 12
_LOOKED_AT: Final = 256
#: Harmonics of the phase in what is expected: half of what is done at all of them is chance.
_HARMONICS: Final = 3
#: A recording has another phase when its loss falls by more than chance lets one number fall.
_CHANCE: Final = 4.0
#: Phases and numbers follow each other so often at the most.
_ROUNDS: Final = 10
#: A shorter turn, in standard errors, is none.
_NO_TURN: Final = 1e-9


@dataclass(frozen=True)
class Turned:
    """Phases of a ripple, and what goes with them along straight lines."""

    phases: tuple[float | None, ...]  #: of each recording, rad from 0 to 2 pi
    x: Floats  #: (k,) coordinates
    value: Floats  #: (n,) expected


def sharper_phases(problem: Problem, fitted: Fit, seed: int) -> Turned:
    """Return the phase of the ripple in each recording, and coordinates that go with them.

    A phase stays where none is better. Numbers that were fitted at other phases hold on to these, and the other way
    round: so both are moved together, the numbers along straight lines.

    Parameters
    ----------
    fitted
        A model with a ripple whose phase is open.
    """
    at = _Search(problem, fitted, seed)
    found, moved = problem.phases, np.zeros(len(fitted.x))
    for _ in range(_ROUNDS):
        before, found = found, at.phases(moved)
        moved = at.numbers(found)
        if found == before:
            break
    x = inside(fitted.slots, fitted.x + moved)
    return Turned(found, x, at.expected(found, x - fitted.x))


class _Search:
    """What a fitted model expects of each recording at many phases of the ripple.

    How that changes with the phase is simulated, with the same random numbers at all of them. What the fit expects at
    the phase that it has is known better than that, and is kept.
    """

    def __init__(self, problem: Problem, fitted: Fit, seed: int) -> None:
        self._problem, self._fitted = problem, fitted
        at = 2.0 * math.pi * np.arange(_SIMULATED) / _SIMULATED
        turned = [replace(problem, phases=(float(phase),) * len(problem.points)) for phase in at]
        models = [fitted.models(one) for one in turned]
        seen = [
            shifted(problem, problem.expect(sensors), fitted.slots, fitted.x)
            for sensors in problem.forward.run(models, seed)
        ]
        self._fine = 2.0 * math.pi * np.arange(_LOOKED_AT) / _LOOKED_AT
        values = filled(np.stack([e.value_or(np.nan) for e in seen]), np.ones(_SIMULATED))
        waves = np.linalg.lstsq(_harmonics(at), values, rcond=None)[0]
        self._expected = self._anchored(_harmonics(self._fine) @ waves)
        near = [seen[round(phase / (2.0 * math.pi) * _SIMULATED) % _SIMULATED].roots for phase in self._fine]
        self._residual = [
            np.stack([roots[i] @ (problem.measured.value[where] - expected[where])
                      for roots, expected in zip(near, self._expected, strict=True)])
            for i, where in enumerate(problem.measured.points)
        ]  # fmt: skip
        changes = fitted.jacobian.mean(axis=0)
        self._changes = [
            np.stack([roots[i] @ changes[where] for roots in near]) for i, where in enumerate(problem.measured.points)
        ]

    def _anchored(self, simulated: Floats) -> Floats:
        """Return (phases, n) what is expected, less what the fit knows better of it."""
        found = simulated.copy()
        for where, phase in zip(self._problem.measured.points, self._problem.phases, strict=True):
            if phase is not None:
                error = self._fitted.value[where] - simulated[self._place(phase), where]
                found[:, where] += np.where(self._fitted.known[where], error, 0.0)
        return found

    def phases(self, moved: Floats) -> tuple[float | None, ...]:
        """Return the best phase of each recording once the numbers have moved; the known one where it is as good."""
        found = list(self._problem.phases)
        for i, (residual, changes) in enumerate(zip(self._residual, self._changes, strict=True)):
            losses = [robust.loss(r - c @ moved) for r, c in zip(residual, changes, strict=True)]
            known = found[i]
            before = math.inf if known is None else losses[self._place(known)]
            if min(losses) < before - _CHANCE:
                found[i] = float(self._fine[int(np.argmin(losses))])
        return tuple(found)

    def numbers(self, phases: Sequence[float | None]) -> Floats:
        """Return how far the numbers move, along straight lines, while each phase follows them.

        So what a turn of the phase could take up, in its recording, says nothing about them.
        """
        known = [(i, self._place(phase)) for i, phase in enumerate(phases) if phase is not None]
        parts = [self._beyond_turn(i, place) for i, place in known]
        residual, columns = (np.concatenate(rows) for rows in zip(*parts, strict=True))
        return explain(self._fitted, columns, residual, None).base

    def expected(self, phases: Sequence[float | None], moved: Floats) -> Floats:
        """Return (n,) what is expected at some phases once the numbers have moved."""
        value = self._fitted.value + self._fitted.jacobian.mean(axis=0) @ moved
        for where, known, phase in zip(self._problem.measured.points, self._problem.phases, phases, strict=True):
            if phase is None:
                continue
            # Of a phase that was open the fit says nothing, but how the numbers move.
            before = self._fitted.value[where] if known is None else self._expected[self._place(known), where]
            value[where] += self._expected[self._place(phase), where] - before
        return np.asarray(value)

    def _beyond_turn(self, i: int, place: int) -> tuple[Floats, Floats]:
        """Return residuals and changes of a recording less what goes with a small turn of its phase."""
        residual, changes = self._residual[i], self._changes[i][place]
        turn = residual[(place + 1) % _LOOKED_AT] - residual[place - 1]
        unit = turn / max(float(np.linalg.norm(turn)), _NO_TURN)
        return residual[place] - unit * (unit @ residual[place]), changes - np.outer(unit, unit @ changes)

    def _place(self, phase: float) -> int:
        return round(phase / (2.0 * math.pi) * _LOOKED_AT) % _LOOKED_AT


def _harmonics(phase: Floats) -> Floats:
    turns = np.outer(phase, np.arange(1, _HARMONICS + 1))
    return np.concatenate([np.ones((len(phase), 1)), np.cos(turns), np.sin(turns)], axis=1)
