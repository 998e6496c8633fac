"""Fitting the free numbers of a model to a run: Gauss-Newton steps on simulated expectations.

Every expectation is simulated, so any effect can be fitted, a user's own too. The same random numbers are used for
all parameters of one step. What is simulated is uncertain: near the minimum it is simulated with more effort, and
what a step has changed in truth corrects the changes by coordinate. These come from two sensors, so that products of
one sensor's changes with the other's have no chance in them: squares would count it as information.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis import robust
from bench.diagnosis.parameters import ALIGNMENT, move
from bench.diagnosis.residuals import expectation, measured
from bench.diagnosis.summary import add

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.forward import Sensor
    from bench.diagnosis.problem import Problem, Slot
    from bench.diagnosis.residuals import Expectation
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]

_LOG = logging.getLogger(__name__)

__all__ = [
    "Approach",
    "Fit",
    "approach",
    "finish",
    "fit",
    "further",
    "live",
    "longest_of",
    "prior_precision",
    "solve",
]

_ITERATIONS: Final = 8
#: Effort of one expectation on the way, and at the solution.
_ROUGH: Final = 0.15
_SHARP: Final = 0.6
_FINE: Final = 3.0
_POLISHINGS: Final = 5
#: The loss is known to about this; a step that makes it so many times larger went wrong; what is at a loss so much
#: larger than the least counts as close by.
_CHANCE: Final = 30.0
_WORSE: Final = 1.2
_CLOSE: Final = 40.0
#: Width of a sharp look, in usual steps, and the longest last step, beside the longest of all.
_SPAN: Final = 2.0
_LAST: Final = 0.1
#: A loss per statistic above this is no matter of effort.
_HOPELESS: Final = 3.0
#: Parts of the longest step within which one is looked for; below the limit the fit ends.
_RADII: Final = (1.0, 0.3, 0.1)
_SHORTEST: Final = 0.02
#: After so many steps the changes by coordinate are simulated again.
_LOOKS: Final = 2
#: After the longest of them was the best, the next may be longer.
_GROWS: Final = 4.0
#: Changes by coordinate are first taken over so many steps, then over fewer: far away chance in them counts more.
_WIDE: Final = 4.0
_NARROWER: Final = 0.5
#: A fit ends when a step would lower the loss by less than this.
_SMALL: Final = 1.0
#: A larger standard error stands for a statistic that was not measured, or is not predicted.
_KNOWN: Final = 1e5
#: Combinations of statistics that hardly vary are left out: their rows are zero.
_LIVE: Final = 1e-5


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
    frozen: Floats | None = None  #: (k,) variance of the coordinates from what is frozen in the pixels of all points
    common: float = 1.0
    """Variance of what several points have in common, beside that of each: they were simulated as one."""

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        """(n,) which statistics say something: they were measured, and are predicted."""
        return self.deviation < _KNOWN

    @property
    def caution(self) -> float:
        """Variance of the independent residuals, for tests: rare events scatter less than stated, others do not."""
        return max(self.scale, 1.0)

    @property
    def z(self) -> Floats:
        """(n,) residuals in standard errors, each on its own."""
        return np.asarray(self.residual / (self.deviation * np.sqrt(self.caution)))

    def whiten(self, values: Floats, points: Sequence[slice]) -> Floats:
        """Return residuals, or columns of changes, as independent numbers of unit variance."""
        return np.asarray(_whiten(self.roots, values, points) / math.sqrt(self.caution))

    def covariance(self, points: Sequence[slice]) -> Floats:
        """(k, k) covariance of the coordinates."""
        first, second = (self.whiten(j, points) for j in self.jacobian)
        information = robust.positive(first.T @ second) + np.diag(prior_precision(self.slots))
        found = np.asarray(np.linalg.pinv(information), np.float64)
        return found if self.frozen is None else found + np.diag(self.frozen)


@dataclass(frozen=True)
class Approach:
    """A model near the minimum, as far as little effort tells."""

    model: PixelModel
    slots: tuple[Slot, ...]
    at: Floats  #: (k,) coordinates
    start: Floats  #: (k,) of the prior
    loss: float
    seed: int


def fit(problem: Problem, model: PixelModel, slots: Sequence[Slot], x: Sequence[float], *, seed: int) -> Fit:
    """Return the model with its numbers fitted, from the coordinates `x` on; see :func:`approach`."""
    return finish(problem, approach(problem, model, slots, x, seed=seed))


def approach(
    problem: Problem, model: PixelModel, slots: Sequence[Slot], x: Sequence[float], *, seed: int,
    iterations: int = _ITERATIONS, span: float = _WIDE, prior: Floats | None = None,
) -> Approach:  # fmt: skip
    """Go near the minimum with little effort.

    Parameters
    ----------
    x
        Coordinates to start from.
    seed
        Of the simulations.
    iterations
        Steps at the most.
    span
        Changes by coordinate are first taken over so many steps: several where the start may be far off.
    prior
        Coordinates that are expected before; None: those to start from.
    """
    slots = tuple(slots)
    at = np.array(x, dtype=np.float64)
    start = at.copy() if prior is None else prior
    radius = 1.0
    here, jacobian = _look(problem, model, slots, at, seed, span)
    now = _loss(problem, here, slots, at, start)
    for step in range(iterations):
        deltas, gains = zip(
            *(_step(problem, here, jacobian, slots, at, start, radius * part) for part in _RADII), strict=True
        )
        _LOG.debug(
            "step %d, radius %.2g, loss %.5g, gain %.4g, at %s", step, radius, now, gains[0], _shown(slots, at)
        )
        if span <= 1.0 and gains[0] < _SMALL:
            break
        tries = [_inside(slots, at + delta) for delta in deltas]
        found = _expect(problem, model, slots, tries, seed)
        losses = [_loss(problem, e, slots, t, start) for e, t in zip(found, tries, strict=True)]
        best = int(np.argmin(losses))
        better = losses[best] < now
        radius = min(radius * (_GROWS if best == 0 else _RADII[best]), 1.0) if better else radius * _RADII[-1]
        span = max(span * _NARROWER, 1.0)
        if better:
            there = found[best]
            jacobian = _corrected(jacobian, tries[best] - at, there.value - here.value, longest_of(slots, at))
            at, now, here = tries[best], losses[best], there
        if radius < _SHORTEST:
            break
        if step < iterations - 1 and (not better or step % _LOOKS == _LOOKS - 1):
            here, jacobian = _look(problem, model, slots, at, seed, span)
    return Approach(model, slots, at, start, now, seed)


def further(problem: Problem, near: Approach, iterations: int) -> Approach:
    """Go on."""
    return approach(
        problem, near.model, near.slots, list(near.at), seed=near.seed, iterations=iterations, span=1.0,
        prior=near.start,
    )  # fmt: skip


def finish(problem: Problem, near: Approach) -> Fit:
    """Go to the minimum with more effort, and return the fit there."""
    model, slots, at, start, seed = near.model, near.slots, near.at, near.start, near.seed + 1
    # A model that is far off is not worth the effort.
    close = near.loss < _HOPELESS * len(problem.measured.labels)
    looked = _look(problem, model, slots, at, seed + 1, _SPAN if close else 1.0, sharp=close)[1]
    jacobian = looked
    simulated = problem.simulate([problem.models(model, slots, at)], seed, _FINE)[0]
    here = _shifted(problem, problem.expect(simulated), slots, at)
    visited = [(at, here)]
    seen = [simulated]
    for k in range(_POLISHINGS if close else 0):
        delta, gain = _step(problem, here, jacobian, slots, at, start, 1.0)
        if gain < _SMALL:
            break
        to = at + delta
        again = problem.simulate([problem.models(model, slots, to)], seed + 10 * (k + 1), _FINE)[0]
        there = _shifted(problem, problem.expect(again), slots, to)
        before, after = _loss(problem, here, slots, at, start), _loss(problem, there, slots, to, start)
        _LOG.debug("polishing, loss %.5g to %.5g, gain %.4g, at %s", before, after, gain, _shown(slots, to))
        visited.append((to, there))
        seen.append(again)
        if after < before + _CHANCE:
            at, here, simulated = to, there, again
        elif after > _WORSE * before:
            jacobian = _corrected(jacobian, delta, there.value - here.value, longest_of(slots, at))
    here = _pooled(problem, visited, jacobian, slots, at, start)
    # The last step is small: what is expected there follows from the changes by coordinate.
    last = _inside(slots, at + _step(problem, here, jacobian, slots, at, start, _LAST if close else _SHORTEST)[0])
    value = here.value + jacobian.mean(axis=0) @ (last - at)
    _LOG.debug("last, loss %.5g to %.5g, at %s", _loss(problem, here, slots, at, start),
               _loss(problem, replace(here, value=value), slots, last, start), _shown(slots, last))  # fmt: skip
    models = problem.models(model, slots, last)
    found = Fit(
        model=models[0],
        slots=slots,
        x=last,
        start=start,
        value=value,
        ratio=here.ratio,
        roots=here.roots(),
        deviation=here.deviation,
        jacobian=looked,
        scale=_scale(simulated),
        residual=problem.measured.value - value,
        common=(1.0 + problem.alike(models) / here.recordings) / here.more,
    )
    return replace(found, frozen=_frozen(problem, found, seen, problem.alike(models)))


def _frozen(problem: Problem, found: Fit, seen: Sequence[Sequence[Sensor]], alike: float) -> Floats:
    """Return by how much the coordinates vary from sensor to sensor beyond what independent points explain.

    What is frozen in a pixel is common to all points; the covariance of the statistics of each point does not know
    it. Where several points are simulated as one, so much more variance is no sign of it.
    """
    points = problem.measured.points
    columns = found.whiten(found.jacobian.mean(axis=0), points)
    left = columns.T @ columns + np.diag(prior_precision(found.slots))
    squares, freedom = np.zeros(len(found.x)), 0
    for sensors in seen:
        values = np.stack([problem.expect([one]).value for one in sensors])
        for away in values - values.mean(axis=0):
            x = np.linalg.lstsq(left, columns.T @ found.whiten(away, points), rcond=1e-10)[0]
            squares += x * x * sensors[0].share
        freedom += len(sensors) - 1
    known = np.diag(found.covariance(points)) / (1.0 + 1.0 / max(len(seen[0]), 1))
    return np.asarray(np.maximum(squares / max(freedom, 1) - alike * known, 0.0))


def _pooled(
    problem: Problem, visited: Sequence[tuple[Floats, Expectation]], jacobian: Floats, slots: Sequence[Slot],
    at: Floats, start: Floats,
) -> Expectation:  # fmt: skip
    """Return what is expected at a place, from the simulations there and at all places close by."""
    losses = [_loss(problem, e, slots, x, start) for x, e in visited]
    close = [v for v, loss in zip(visited, losses, strict=True) if loss <= min(losses) + _CLOSE]
    here = next(e for x, e in visited if x is at)
    change = jacobian.mean(axis=0)
    total = sum(e.recordings for _, e in close)
    value = sum((e.recordings / total) * (e.value + change @ (at - x)) for x, e in close)
    return replace(here, value=np.asarray(value), recordings=total)


def _corrected(jacobian: Floats, delta: Floats, change: Floats, longest: Floats) -> Floats:
    """Return the changes by coordinate, made right along a step of which the change is known better.

    Source: C. G. Broyden, "A class of methods for solving nonlinear simultaneous equations", Math. Comp. 19 (1965).
    """
    scaled = delta / longest**2
    along = scaled / max(float(delta @ scaled), 1e-300)
    return np.stack([j + np.outer(change - j @ delta, along) for j in jacobian])


def _shown(slots: Sequence[Slot], at: Floats) -> str:
    return " ".join(f"{s.free.name}={s.free.value(x):.5g}" for s, x in zip(slots, at, strict=True))


def _look(
    problem: Problem, model: PixelModel, slots: Sequence[Slot], at: Floats, seed: int, span: float,
    *, sharp: bool = False,
) -> tuple[Expectation, Floats]:  # fmt: skip
    """Return what is expected at these coordinates, and (2, n, k) how that changes, from each of two sensors.

    `span` is the difference between coordinates over which a change is taken, in usual steps; for a sharp look it is
    taken to both sides, with more effort.
    """
    simulated = [i for i, slot in enumerate(slots) if slot.free.owner != ALIGNMENT]
    ends = []
    for i in simulated:
        to = at.copy()
        to[i] = move(slots[i].free, at[i], span)
        opposite = at.copy()
        opposite[i] = max(2.0 * at[i] - to[i], slots[i].free.range[0]) if sharp else at[i]
        ends.append((opposite, to))
    places = [at, *(to for _, to in ends), *(back for back, _ in ends if sharp)]
    found = problem.simulate([problem.models(model, slots, x) for x in places], seed, _SHARP if sharp else _ROUGH)
    here = _shifted(problem, problem.expect(found[0]), slots, at)
    out = np.zeros((2, len(here.value), len(slots)))
    for i, slot in enumerate(slots):
        if slot.free.owner == ALIGNMENT:
            out[:, :, i] = later(problem, here)
    above = found[1 : 1 + len(ends)]
    below = found[1 + len(ends) :] if sharp else [found[0]] * len(ends)
    for half in range(2):
        for i, up, down, (back, to) in zip(simulated, above, below, ends, strict=True):
            apart = problem.expect(up[half::2]).value - problem.expect(down[half::2]).value
            out[half, :, i] = apart / (to[i] - back[i])
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


def solve(columns: Floats, residual: Floats, prior: Floats) -> Floats:
    """Return the least-squares coordinates of `residual` in `columns`, with a prior precision of each."""
    left = columns.T @ columns + np.diag(prior)
    return np.asarray(np.linalg.lstsq(left, columns.T @ residual, rcond=1e-10)[0])


def _expect(
    problem: Problem, model: PixelModel, slots: Sequence[Slot], xs: Sequence[Floats], seed: int
) -> list[Expectation]:
    found = problem.simulate([problem.models(model, slots, x) for x in xs], seed, _ROUGH)
    return [_shifted(problem, problem.expect(sensors), slots, x) for sensors, x in zip(found, xs, strict=True)]


def _shifted(problem: Problem, here: Expectation, slots: Sequence[Slot], x: Floats) -> Expectation:
    """Return what is expected when the events come later by the time offset among the coordinates."""
    late: float = sum(c for slot, c in zip(slots, x, strict=True) if slot.free.owner == ALIGNMENT)
    return replace(here, value=here.value + late * later(problem, here)) if late else here


def _step(
    problem: Problem, here: Expectation, jacobian: Floats, slots: Sequence[Slot], at: Floats, start: Floats,
    radius: float,
) -> tuple[Floats, float]:  # fmt: skip
    """Return the step that lowers the loss most where all changes are linear, and by how much; not a long one."""
    points, roots = problem.measured.points, here.roots()
    longest = radius * longest_of(slots, at)
    low, high = (np.array([s.free.range[end] for s in slots]) for end in (0, 1))
    delta, gain = robust.solve(
        _whiten(roots, jacobian.mean(axis=0), points),
        _whiten(roots, problem.measured.value - here.value, points),
        prior_precision(slots),
        start - at,
        np.maximum(low - at, -longest),
        np.minimum(high - at, longest),
    )
    return delta, gain


def _whiten(roots: Sequence[Floats], values: Floats, points: Sequence[slice]) -> Floats:
    return np.concatenate([root @ values[where] for root, where in zip(roots, points, strict=True)])


def longest_of(slots: Sequence[Slot], at: Floats) -> Floats:
    """(k,) how far each coordinate may go from here before straight lines say nothing."""
    return np.array([_longest(s, a) for s, a in zip(slots, at, strict=True)])


#: No step is longer than this: in ln units for a threshold, and for other numbers of the base pixel.
_LONGEST_THRESHOLD: Final = 0.3
_LONGEST_BASE: Final = 0.7


def _longest(slot: Slot, at: float) -> float:
    free = slot.free
    if free.owner == ALIGNMENT:
        return 4.0 * free.prior_sd
    if not free.effect:
        return _LONGEST_THRESHOLD if free.owner == "thresholds" else _LONGEST_BASE
    if free.scale == "log":
        return 1.0
    probe = abs(free.coordinate(free.probe))
    return max(abs(at), probe)


def _inside(slots: Sequence[Slot], x: Floats) -> Floats:
    return np.array([min(max(c, s.free.range[0]), s.free.range[1]) for s, c in zip(slots, x, strict=True)])


def prior_precision(slots: Sequence[Slot]) -> Floats:
    """(k,) precision with which each coordinate is known before."""
    return np.array([0.0 if np.isinf(s.free.prior_sd) else s.free.prior_sd**-2 for s in slots])


def _loss(problem: Problem, here: Expectation, slots: Sequence[Slot], at: Floats, start: Floats) -> float:
    """Return the loss of the independent residuals, and what the prior adds."""
    residual = _whiten(here.roots(), problem.measured.value - here.value, problem.measured.points)
    return robust.loss(residual) + float(np.sum(prior_precision(slots) * (at - start) ** 2))


def live(root: Floats) -> Floats:
    """(k,) which combinations of the statistics of a point count."""
    return np.asarray(np.abs(root).sum(axis=1) > _LIVE)


def _scale(sensors: Sequence[Sensor]) -> float:
    """Return the mean square residual of a run of the model itself: each simulated sensor against the others."""
    squares, freedom = 0.0, 0
    for i, one in enumerate(sensors):
        others = [s.summaries for k, s in enumerate(sensors) if k != i]
        as_run = measured(one.summaries)
        expected = expectation(as_run, [add(column) for column in zip(*others, strict=True)])
        for root, where in zip(expected.roots(), as_run.points, strict=True):
            counts = live(root)
            squares += float(np.sum((root @ (as_run.value[where] - expected.value[where]))[counts] ** 2))
            freedom += int(counts.sum())
    return max(squares / max(freedom, 1), 1e-3)
