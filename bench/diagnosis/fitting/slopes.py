"""How what is expected changes by coordinate, from all that was simulated around a place."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bench.diagnosis.expected.parameters import ALIGNMENT
from bench.diagnosis.expected.residuals import filled
from bench.diagnosis.fitting.looks import delays, later
from bench.diagnosis.fitting.steps import inside

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.forward import Sensor
    from bench.diagnosis.expected.problem import Problem, Slot
    from bench.diagnosis.expected.residuals import Expectation
    from bench.diagnosis.fitting.fitted import Fit
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]

__all__ = ["Around", "AsBefore", "Sample", "sample_of", "samples_around", "slopes"]


@dataclass(frozen=True)
class Sample:
    """Coordinates, and what two independent sensors let expect there, whose events come when the stimulus says."""

    at: Floats  #: (k,)
    halves: Floats  #: (2, n); NaN where a half says nothing: of no events there is no mean
    recordings: float
    pair: int = -1  #: samples of a pair lie to both sides of a place, in the same random numbers; -1: of none


def sample_of(problem: Problem, at: Floats, sensors: Sequence[Sensor], pair: int = -1) -> Sample:
    """Return simulated sensors as a sample."""
    halves = [problem.expect(sensors[half::2]) for half in range(2)]
    values = np.stack([e.value_or(np.nan) for e in halves])
    return Sample(at, values, sum(e.recordings for e in halves), pair)


def samples_around(
    problem: Problem, model: PixelModel, slots: Sequence[Slot], at: Floats, seed: int, directions: Floats,
    effort: float,
) -> list[Sample]:  # fmt: skip
    """Simulate to both sides of a place.

    Parameters
    ----------
    at
        (k,) coordinates.
    directions
        (k, m) in the columns: how far to go.
    effort
        For each sample.
    """
    places = [inside(slots, at + sign * way) for way in directions.T for sign in (1.0, -1.0)]
    found = problem.simulate([problem.models(model, slots, x) for x in places], seed, effort)
    return [sample_of(problem, x, sensors, i // 2) for i, (x, sensors) in enumerate(zip(places, found, strict=True))]


@dataclass(frozen=True)
class Around:
    """Changes by coordinate that follow from all that was simulated around a place, and on the way from there."""

    problem: Problem
    slots: Sequence[Slot]
    samples: list[Sample]
    directions: Floats  #: (k, m) in which was looked
    centre: Floats  #: (k,) coordinates around which was looked

    def farther(self, model: PixelModel, number: int, times: float, seed: int, effort: float) -> Around:
        """Return the same, having looked farther in one direction, too."""
        ways = self.directions.copy()
        ways[:, number] *= times
        fresh = samples_around(self.problem, model, self.slots, self.centre, seed, ways[:, [number]], effort)
        pair = 1 + max(sample.pair for sample in self.samples)
        more = [replace(sample, pair=pair) for sample in fresh]
        return replace(self, samples=[*self.samples, *more], directions=ways)

    def add(self, at: Floats, sensors: Sequence[Sensor]) -> None:
        """Take what was simulated at some coordinates into account."""
        self.samples.append(sample_of(self.problem, at, sensors))

    def slopes(self, at: Floats, here: Expectation) -> Floats:
        """Return (2, n, k) the changes around some coordinates."""
        return slopes(self.problem, self.slots, at, here, self.samples, self.directions)

    def distance(self, at: Floats) -> float:
        """Return how far some coordinates are from where was looked around, beside how far was looked."""
        return float(np.linalg.norm(np.linalg.pinv(self.directions) @ (at - self.centre)))


@dataclass(frozen=True)
class AsBefore:
    """Changes by coordinate as an earlier fit knows them, but for what later events do to latencies.

    Nothing is simulated for them. The logarithm of a latency changes the less the longer the latency is.
    """

    problem: Problem
    slots: Sequence[Slot]
    fit: Fit

    def add(self, _at: Floats, _sensors: Sequence[Sensor]) -> None:
        """Leave them as they are."""

    def distance(self, _at: Floats) -> float:
        """Return 0: nowhere was looked around."""
        return 0.0

    def slopes(self, _at: Floats, here: Expectation) -> Floats:
        """Return (2, n, k) the changes."""
        late, before = later(self.problem, here), later(self.problem, self.fit)
        known = (late != 0.0) & (before != 0.0)
        out = self.fit.jacobian * np.divide(late, before, out=np.ones_like(late), where=known)[:, None]
        out[:, :, [delays(slot.free) for slot in self.slots]] = late[:, None]
        return np.asarray(out)


def slopes(
    problem: Problem, slots: Sequence[Slot], at: Floats, here: Expectation, samples: Sequence[Sample],
    directions: Floats,
) -> Floats:  # fmt: skip
    """Return (2, n, k) the slopes of straight lines through samples, for each of the two sensors.

    Samples count by the number of simulated pixels, less beyond the directions in which was looked, where lines are
    not straight. The lines through the pairs are parallel, no more: how a line bends lifts both ends of it, which
    others would take for their slope where a bound leaves them one side. What later events do to latencies is known;
    a time offset is not in the samples.

    A sample that says nothing of a statistic is taken to say that it is as it is here, or else in the other samples.
    So what depends on the number of pixels, of which samples have but a part, does not change: it is judged, and no
    number is fitted to it.
    """
    offset = np.array([slot.free.owner == ALIGNMENT for slot in slots])
    delayed = np.array([delays(slot.free) for slot in slots]) & ~offset
    late = later(problem, here)
    away = np.stack([s.at - at for s in samples]) @ np.linalg.pinv(directions).T
    beyond = np.maximum(np.sum(away**2, axis=1) - 1.0, 0.0)
    weight = np.array([s.recordings for s in samples]) * np.exp(-0.5 * beyond)
    pairs = np.array([s.pair for s in samples])
    levels = (pairs[:, None] == np.unique(pairs)).astype(np.float64)
    columns = np.column_stack([levels, np.stack([s.at - at for s in samples])[:, ~offset]])
    root = np.sqrt(weight)[:, None]
    scale = np.array([*np.ones(levels.shape[1]), *np.maximum(np.abs(directions).max(axis=1)[~offset], 1e-300)])
    back = np.linalg.pinv(root * columns / scale) * root[:, 0]
    out = np.zeros((2, len(here.value), len(slots)))
    for half in range(2):
        values = np.stack([s.halves[half] - np.sum((s.at - at)[delayed]) * late for s in samples])
        values = filled(np.where(np.isfinite(values), values, here.value_or(np.nan)), weight)
        out[half][:, ~offset] = ((back @ values) / scale[:, None])[levels.shape[1] :].T
    # A dead time that begins later does little beside what chance makes of it, and nothing else tells a delay from a
    # clock: taken for information it led delays of 80 us away by 30, with the clock as far on the other side.
    out[:, :, offset | delayed] = late[:, None]
    return out
