"""Fitting the free numbers of a model to a run: Gauss-Newton steps on simulated expectations.

Every expectation is simulated, so any effect can be fitted, a user's own too. The same random numbers are used for
all parameters of one fit, and what differs by no more than chance is taken not to differ.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.parameters import ALIGNMENT, move
from bench.diagnosis.residuals import expectation, measured
from bench.diagnosis.summary import add

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.problem import Problem, Slot
    from bench.diagnosis.residuals import Expectation
    from bench.diagnosis.summary import Summary
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]

_LOG = logging.getLogger(__name__)

__all__ = ["Fit", "fit", "prior_precision", "shrunk", "solve"]

_ITERATIONS: Final = 7
#: Changes below so many standard errors of the simulation are taken for chance.
_CHANCE: Final = 1.7
#: A step is not longer than this in any coordinate, in units of its probe.
_SENSORS: Final = 2
_LONGEST: Final = 6.0
#: Parts of a step that are tried.
_LENGTHS: Final = (1.0, 0.4)
#: A step longer than this part of the longest makes the changes by coordinate worth another simulation.
_FAR: Final = 0.1
#: Mean square of a residual up to which there is no doubt about the model.
_USUAL: Final = 1.5
#: From step to step the doubt falls by at least this factor; below the limit there is none.
_TRUST: Final = 0.25
_NO_DOUBT: Final = 3e-3
_HALVINGS: Final = 24
#: Statistics whose standard error is larger are not known.
_KNOWN: Final = 1e5
#: A fit ends when a step would lower the loss by less than this.
_SMALL: Final = 1.0


@dataclass(frozen=True)
class Fit:
    """A model fitted to a run."""

    model: PixelModel  #: with the effects that it has; its numbers are those of `x`
    slots: tuple[Slot, ...]
    x: Floats  #: (k,) coordinates
    start: Floats  #: (k,) of the prior
    value: Floats  #: (n,) expected, transformed
    ratio: Floats  #: (n,) expected, in the unit of the label
    roots: tuple[Floats, ...]  #: of each point: makes its residuals independent, of unit variance
    deviation: Floats  #: (n,) standard errors of measured less expected
    jacobian: Floats  #: (2, n, k) change of the expected values by coordinate, from two sensors
    scale: float  #: mean square of the residuals of a run of the model itself
    residual: Floats  #: (n,) measured less expected, transformed

    @property
    def z(self) -> Floats:
        """(n,) residuals in standard errors, each on its own."""
        return np.asarray(self.residual / (self.deviation * np.sqrt(self.scale)))

    def whiten(self, values: Floats, points: Sequence[slice]) -> Floats:
        """Return residuals, or columns of changes, as independent numbers of unit variance."""
        parts = [root @ values[where] for root, where in zip(self.roots, points, strict=True)]
        return np.asarray(np.concatenate(parts) / np.sqrt(self.scale))

    def covariance(self, points: Sequence[slice]) -> Floats:
        """(k, k) covariance of the coordinates."""
        first, second = (self.whiten(j, points) for j in self.jacobian)
        information = _positive(first.T @ second) + np.diag(prior_precision(self.slots))
        return np.asarray(np.linalg.pinv(information), np.float64)


def fit(
    problem: Problem, model: PixelModel, slots: Sequence[Slot], x: Sequence[float], *, seed: int, sensors: int = 4,
    iterations: int = _ITERATIONS,
) -> Fit:  # fmt: skip
    """Return the model with its numbers fitted.

    Parameters
    ----------
    x
        Coordinates to start from.
    seed
        Of the simulations.
    sensors
        Simulated in the end, to sharpen what is expected.
    """
    slots = tuple(slots)
    start = np.array(x, dtype=np.float64)
    at = start.copy()
    here, jacobian = _look(problem, model, slots, at, seed)
    doubt = math.inf
    for step in range(iterations):
        doubt = min(doubt_of(problem, here), _TRUST * doubt)
        doubt = doubt if doubt > _NO_DOUBT else 0.0
        delta, gain = _step(problem, here, jacobian, doubt, slots, at, start)
        _LOG.debug("step %d, doubt %.3g, loss %.5g, gain %.4g", step, doubt, _loss(problem, here, 0.0), gain)
        if doubt == 0.0 and gain < _SMALL:
            break
        tries = [_inside(slots, at + length * delta) for length in _LENGTHS]
        found = _expect(problem, model, slots, tries, seed)
        best = min(range(len(tries)), key=lambda k: _loss(problem, found[k], doubt))
        if _loss(problem, found[best], doubt) >= _loss(problem, here, doubt):
            if doubt == 0.0:
                break
            continue
        far = float(np.max(np.abs(tries[best] - at) / _longest_of(slots, at), initial=0.0)) > _FAR
        at, here = tries[best], found[best]
        if far and step < iterations - 1:
            here, jacobian = _look(problem, model, slots, at, seed)
    return finish(problem, model, slots, at, start, jacobian, seed + 1, sensors)


def finish(
    problem: Problem, model: PixelModel, slots: tuple[Slot, ...], at: Floats, start: Floats, jacobian: Floats,
    seed: int, sensors: int,
) -> Fit:  # fmt: skip
    """Simulate several sensors, take a last step on what they let expect, and return the fit."""
    simulated = problem.simulate([problem.models(model, slots, at)], seed, sensors)[0]
    here = _shifted(problem, problem.expect(simulated), slots, at)
    delta, _ = _step(problem, here, jacobian, 0.0, slots, at, start)
    # The last step is small: what is expected there follows from the changes by coordinate.
    change = jacobian.mean(axis=0)
    lasts = [_inside(slots, at + length * delta) for length in (0.0, *_LENGTHS)]
    values = [here.value + change @ (last - at) for last in lasts]
    best = min(range(len(lasts)), key=lambda k: _loss(problem, replace(here, value=values[k]), 0.0))
    last, value = lasts[best], values[best]
    return Fit(
        model=problem.models(model, slots, last)[0],
        slots=slots,
        x=last,
        start=start,
        value=value,
        ratio=here.ratio,
        roots=here.roots(),
        deviation=_deviation(here),
        jacobian=jacobian,
        scale=_scale(simulated),
        residual=problem.measured.value - value,
    )


def _look(
    problem: Problem, model: PixelModel, slots: Sequence[Slot], at: Floats, seed: int
) -> tuple[Expectation, Floats]:
    """Return what is expected at these coordinates, and (2, n, k) how that changes, from each of two sensors.

    Two sensors do not share what is chance in their changes. Squares of changes would count it as information, and
    a fit would take it for a steep valley and creep; products of one sensor's changes with the other's do not.
    """
    moved = [at]
    simulated = [i for i, slot in enumerate(slots) if slot.free.owner != ALIGNMENT]
    for i in simulated:
        to = at.copy()
        to[i] = move(slots[i].free, at[i])
        moved.append(to)
    found = problem.simulate([problem.models(model, slots, x) for x in moved], seed, _SENSORS)
    here = _shifted(problem, problem.expect(found[0]), slots, at)
    out = np.zeros((_SENSORS, len(here.value), len(slots)))
    for i, slot in enumerate(slots):
        if slot.free.owner == ALIGNMENT:
            out[:, :, i] = later(problem, here)
    for sensor in range(_SENSORS):
        alone = problem.expect([found[0][sensor]]).value
        for i, there, to in zip(simulated, found[1:], moved[1:], strict=True):
            out[sensor, :, i] = (problem.expect([there[sensor]]).value - alone) / (to[i] - at[i])
    return here, out


def later(problem: Problem, here: Expectation) -> Floats:
    """Return the changes when all events come later than the stimulus says, by second: latencies are longer."""
    change = np.zeros(len(here.value))
    for i, label in enumerate(problem.measured.labels):
        if label.view == "latency" and np.isfinite(here.ratio[i]):
            change[i] = math.exp(-here.ratio[i])
            last = change[i]
        elif label.view == "latency_spread" and np.isfinite(here.ratio[i]):
            change[i] = -2.0 * here.ratio[i] * last
    return change


def shrunk(change: Floats, deviation: Floats) -> Floats:
    """Return a change without what may be chance (non-negative garrote)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        keep = 1.0 - (_CHANCE * deviation / change) ** 2
    return change * np.where(np.isfinite(keep), np.maximum(keep, 0.0), 0.0)


def solve(columns: Floats, residual: Floats, prior: Floats) -> Floats:
    """Return the least-squares coordinates of `residual` in `columns`, with a prior precision of each."""
    left = columns.T @ columns + np.diag(prior)
    return np.asarray(np.linalg.lstsq(left, columns.T @ residual, rcond=1e-10)[0])


def _expect(
    problem: Problem, model: PixelModel, slots: Sequence[Slot], xs: Sequence[Floats], seed: int
) -> list[Expectation]:
    found = problem.simulate([problem.models(model, slots, x) for x in xs], seed, _SENSORS)
    return [_shifted(problem, problem.expect(sensors), slots, x) for sensors, x in zip(found, xs, strict=True)]


def _shifted(problem: Problem, here: Expectation, slots: Sequence[Slot], x: Floats) -> Expectation:
    """Return what is expected when the events come later by the time offset among the coordinates."""
    late: float = sum(c for slot, c in zip(slots, x, strict=True) if slot.free.owner == ALIGNMENT)
    return replace(here, value=here.value + late * later(problem, here)) if late else here


def _deviation(here: Expectation) -> Floats:
    more = 1.0 + 1.0 / here.recordings
    return np.concatenate([np.sqrt(np.diag(c) * more) for c in here.covariance])


def _step(
    problem: Problem, here: Expectation, jacobian: Floats, doubt: float,
    slots: Sequence[Slot], at: Floats, start: Floats,
) -> tuple[Floats, float]:  # fmt: skip
    """Return the Gauss-Newton step, and by how much it would lower the weighted sum of squares.

    `doubt` is an error of the model in each statistic that is allowed for, relative to it: far from the solution the
    sharpest statistics would pull the others with them.
    """
    points, residual = problem.measured.points, problem.measured.value - here.value
    deviation = _deviation(here)
    root_weights = deviation / np.hypot(deviation, doubt * _typical(problem, here))
    roots = here.roots()
    r = np.concatenate([w @ (residual * root_weights)[p] for w, p in zip(roots, points, strict=True)])
    first, second = (
        np.concatenate([w @ (j * root_weights[:, None])[p] for w, p in zip(roots, points, strict=True)])
        for j in jacobian
    )
    information = _positive(first.T @ second)
    prior = prior_precision(slots)
    pull = 0.5 * (first + second).T @ r
    left = information + np.diag(prior)
    delta = np.linalg.lstsq(left, pull + prior * (start - at), rcond=1e-10)[0]
    longest = _longest_of(slots, at)
    delta = delta / max(float(np.max(np.abs(delta) / longest, initial=0.0)), 1.0)
    delta = _inside(slots, at + delta) - at
    return delta, float(2.0 * pull @ delta - delta @ information @ delta)


def _positive(product: Floats) -> Floats:
    """Return the nearest symmetric matrix without negative eigenvalues."""
    values, vectors = np.linalg.eigh(0.5 * (product + product.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def _typical(problem: Problem, here: Expectation) -> Floats:
    """Return the size of each statistic in which a doubt about the model counts."""
    of = problem.measured
    size = np.ones(len(here.value))
    for i, label in enumerate(of.labels):
        if label.kind == "share":
            size[i] = math.sqrt(max(of.bottom[i], 1.0))
        elif label.kind == "count":
            size[i] = max(abs(here.value[i]), abs(of.value[i]))
        elif label.kind == "difference":
            size[i] = 0.25
    return size


def _longest_of(slots: Sequence[Slot], at: Floats) -> Floats:
    return np.array([_longest(s, a) for s, a in zip(slots, at, strict=True)])


def _longest(slot: Slot, at: float) -> float:
    free = slot.free
    if free.owner == ALIGNMENT:
        return 4.0 * free.prior_sd
    if not free.effect:
        return _LONGEST * 0.05 if free.owner == "thresholds" else _LONGEST * 0.15
    if free.scale == "log":
        return 1.0
    probe = abs(free.coordinate(free.probe))
    return max(abs(at), probe)


def _inside(slots: Sequence[Slot], x: Floats) -> Floats:
    return np.array([min(max(c, s.free.range[0]), s.free.range[1]) for s, c in zip(slots, x, strict=True)])


def prior_precision(slots: Sequence[Slot]) -> Floats:
    """(k,) precision with which each coordinate is known before."""
    return np.array([0.0 if np.isinf(s.free.prior_sd) else s.free.prior_sd**-2 for s in slots])


def doubt_of(problem: Problem, here: Expectation) -> float:
    """Return the relative error of the model that makes its residuals as large as they are, all in all; 0 for none.

    With a wrong model the sharpest statistics would otherwise outweigh all others, and pull every number with them.
    """
    residual, deviation = problem.measured.value - here.value, _deviation(here)
    informed = deviation < _KNOWN
    residual, deviation, typical = (a[informed] for a in (residual, deviation, _typical(problem, here)))

    def excess(doubt: float) -> float:
        return float(np.mean(residual**2 / (deviation**2 + (doubt * typical) ** 2))) - _USUAL

    if not informed.any() or excess(0.0) <= 0.0:
        return 0.0
    low, high = 0.0, 1.0
    while excess(high) > 0.0 and high < 1e6:
        high *= 2.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
    return high


def _loss(problem: Problem, here: Expectation, doubt: float) -> float:
    """Return the sum of squares of the residuals, with a doubt about the model."""
    residual = problem.measured.value - here.value
    return float(np.sum(residual**2 / (_deviation(here) ** 2 + (doubt * _typical(problem, here)) ** 2)))


def _scale(sensors: Sequence[Sequence[Summary]]) -> float:
    """Return the mean square residual of a run of the model itself: each simulated sensor against the others."""
    if len(sensors) < 2:
        return 1.0
    squares, freedom = 0.0, 0
    for i, one in enumerate(sensors):
        others = [s for k, s in enumerate(sensors) if k != i]
        as_run = measured(one)
        summed = [add(column) for column in zip(*others, strict=True)]
        expected = expectation(as_run, summed)
        for root, where in zip(expected.roots(), as_run.points, strict=True):
            r = root @ (as_run.value[where] - expected.value[where])
            live = np.abs(root).sum(axis=1) > 1e-5
            squares += float(np.sum(r[live] ** 2))
            freedom += int(live.sum())
    return max(squares / max(freedom, 1), 1e-3)
