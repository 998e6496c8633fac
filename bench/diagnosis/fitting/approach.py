"""The way to the minimum, with little effort: steps along straight lines through a cloud of simulations."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.parameters import ALIGNMENT
from bench.diagnosis.fitting import robust
from bench.diagnosis.fitting.cloud import Cloud, Place, around
from bench.diagnosis.fitting.fitted import prior_precision
from bench.diagnosis.fitting.looks import delays, expect_roughly, later
from bench.diagnosis.fitting.steps import inside, longest_of, shown

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.problem import Problem, Slot
    from bench.diagnosis.expected.residuals import Expectation
    from bench.diagnosis.fitting.cloud import Lines
    from sim_backend.pixel.model import PixelModel

    Bools = npt.NDArray[np.bool_]
    Floats = npt.NDArray[np.float64]

__all__ = ["Approach", "approach", "best_of", "further", "known_beforehand", "scanned"]

_LOG = logging.getLogger(__name__)

#: Steps of a way from anywhere, at the most.
_ITERATIONS: Final = 24
#: The loss is known to about this. A way has come to its end, as far as little effort tells, when steps lower the
#: loss by no more, or by a small share, so often in a row.
_CHANCE: Final = 30.0
_LITTLE: Final = 0.03
_IDLE: Final = 2
#: After more than so many steps a loss that is so many times the one to beat is hopeless.
_SOME: Final = 1
_HOPELESS: Final = 20.0
#: Relative errors that a model may have in turn, where the start may be anywhere: far away standard errors are no
#: measure of how far. The next one's turn is when the loss per statistic is below the limit, or a short step lowers
#: the loss by less than a share.
_MAY_BE_WRONG: Final = (0.3, 0.1, 0.03, 0.0)
_EASY: Final = 0.3
_STILL: Final = 0.2
_SHORT: Final = 0.5
#: The longest step that is tried, beside the longest of all: at the start, and nearby or when a model may be less
#: wrong.
_REACH: Final = 1.0
_NEARBY: Final = 0.3
#: and when a way has come to its end: for sure, or if it is idle.
_SHORTEST: Final = 0.03
_SHORT_ENOUGH: Final = 0.08
#: The next reach beside the step that was best, and by how much it changes at the most.
_NEXT: Final = 2.0
_LESS: Final = 0.5
_MORE: Final = 1.5
#: Lines are drawn through places within this share of the reach.
_WITHIN: Final = 0.5
#: Places beside those that steps lead to, for the lines.
_BESIDE: Final = 4
#: Chance makes slopes look steeper, and steps shorter, than they are: shares of it that are taken off.
_SHARES: Final = (1.0, 0.3, 0.0)
#: Numbers are known beforehand when their precision is more than this.
_KNOWN: Final = 25.0
_AS_GOOD_AS_NONE: Final = 1e-9
#: They are looked around in within so many standard deviations.
_OF_KNOWN: Final = 2.0


@dataclass(frozen=True)
class Approach:
    """A model near the minimum, as far as little effort tells."""

    model: PixelModel
    slots: tuple[Slot, ...]
    at: Floats  #: (k,) coordinates
    start: Floats  #: (k,) of the prior
    loss: float
    seed: int
    information: Floats  #: (k, k) about the coordinates, in all statistics; roughly
    reach: float  #: of the last step, beside the longest
    cloud: Cloud  #: what was looked at on the way


def approach(
    problem: Problem, model: PixelModel, slots: Sequence[Slot], x: Sequence[float], *, seed: int,
    iterations: int = _ITERATIONS, wrong: float = 0.0, prior: Floats | None = None, cloud: Cloud | None = None,
    reach: float | None = None, beat: float = math.inf, leave: float = math.inf,
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
    wrong
        Relative error that what is expected may have at the start.
    prior
        Coordinates that are expected before; None: those to start from.
    cloud
        What was looked at before, of the same model.
    reach
        Of the first step, beside the longest; None: far, if the start may be wrong.
    beat
        A loss to come close to: what is hopelessly far from it after some steps goes no further.
    leave
        The same of what has more than this share of the loss at the start left by then.
    """
    at = np.array(x, dtype=np.float64)
    way = _Way(problem, model, tuple(slots), at if prior is None else prior, seed, cloud or Cloud())
    way.set_out(at, reach or (_REACH if wrong else _NEARBY), wrong)
    most = min(_HOPELESS * beat, leave * way.loss)
    for number in range(iterations):
        if way.step() or (number >= _SOME and way.loss > most):
            break
    return way.end()


def best_of(
    problem: Problem, model: PixelModel, slots: Sequence[Slot], starts: Sequence[Sequence[float]], *, seed: int,
    wrong: float,
) -> Sequence[float]:  # fmt: skip
    """Return those of some coordinates from which the run is nearest, if what is expected may be so wrong there."""
    places = [np.array(x, dtype=np.float64) for x in starts]
    if len(places) == 1:
        return starts[0]
    way = _Way(problem, model, tuple(slots), places[0], seed, Cloud())
    losses = [way.loss_at(e, x, wrong) for e, x in zip(way.expected(places), places, strict=True)]
    _LOG.debug("starts, losses %s", " ".join(f"{loss:.4g}" for loss in losses))
    return starts[int(np.argmin(losses))]


def known_beforehand(slots: Sequence[Slot]) -> Bools:
    """(k,) which numbers are known so well that on the way to a minimum they would but stand in for others."""
    return np.asarray(prior_precision(slots) > _KNOWN)


def further(problem: Problem, near: Approach, iterations: int) -> Approach:
    """Go on from where it ended."""
    return approach(
        problem, near.model, near.slots, list(near.at), seed=near.seed, iterations=iterations, prior=near.start,
        cloud=near.cloud, reach=near.reach,
    )  # fmt: skip


def scanned(problem: Problem, near: Approach, places: Sequence[Floats]) -> Approach:
    """Return the best of some places, all of which are remembered."""
    way = _Way(problem, near.model, near.slots, near.start, near.seed, near.cloud)
    best = way.look(places)
    return replace(near, at=best.at, loss=best.loss, cloud=way.cloud)


class _Way:
    """From place to place, each time to the best of some that straight lines lead to."""

    def __init__(
        self, problem: Problem, model: PixelModel, slots: tuple[Slot, ...], start: Floats, seed: int, known: Cloud
    ) -> None:
        self._problem, self._model, self._slots, self._start, self._seed = problem, model, slots, start, seed
        self._precision = prior_precision(slots)
        self._offset = np.array([s.free.owner == ALIGNMENT for s in slots])
        self._delays = np.array([delays(s.free) for s in slots])
        self._rng = np.random.default_rng(seed)
        self.cloud = Cloud(known.places)
        self._wrong = 0.0
        self._at: Floats | None = None

    def set_out(self, at: Floats, reach: float, wrong: float) -> None:
        """Look at the start and around it, unless all that was done before."""
        self._wrong, self._reach, self._idle = wrong, reach, 0
        self._turn = [w for w in _MAY_BE_WRONG if w < wrong]
        self._judge()
        known = [place for place in self.cloud.places if np.array_equal(place.at, at)]
        if known:
            self._at = known[0].at
            return
        beside = len(at) if self.cloud.places else 2 * len(at)
        self._at = self.look([at, *self._around(at, beside)]).at

    def look(self, places: Sequence[Floats]) -> Place:
        """Look at some places, and return the best of them."""
        at = [inside(self._slots, place) for place in places]
        seen = [Place(x, e, self.loss_at(e, x)) for x, e in zip(at, self.expected(at), strict=True)]
        self.cloud.places += seen
        return min(seen, key=lambda place: place.loss)

    def expected(self, places: Sequence[Floats]) -> list[Expectation]:
        """Return what is expected at some places, which are not remembered."""
        return expect_roughly(self._problem, self._model, self._slots, places, self._seed)

    @property
    def _here(self) -> Place:
        """The best place so far since the way was set out on."""
        return next(place for place in self.cloud.places if place.at is self._at)

    @property
    def loss(self) -> float:
        """The loss at the best place so far, if the model is right."""
        here = self._here
        return self.loss_at(here.expected, here.at, 0.0)

    def step(self) -> bool:
        """Take a step; return whether the way has come to its end."""
        here = self._here
        best = self.look([*self._tries(), *self._around(here.at, _BESIDE)])
        fell = max(here.loss - best.loss, 0.0)
        if fell:
            self._at = best.at
        size = float(np.max(np.abs(self._here.at - here.at) / longest_of(self._slots, here.at)))
        _LOG.debug("reach %.2g, wrong %.2g, loss %.5g to %.5g, at %s", self._reach, self._wrong, here.loss, best.loss,
                   shown(self._slots, self._here.at))  # fmt: skip
        self._reach = min(max(_NEXT * size, _LESS * self._reach), _MORE * self._reach, _REACH)
        self._idle = self._idle + 1 if fell < max(_CHANCE, _LITTLE * here.loss) else 0
        if not self._wrong:
            return self._reach < _SHORTEST or (self._idle >= _IDLE and self._reach < _SHORT_ENOUGH)
        self._less_wrong(fell / max(here.loss, _CHANCE))
        return False

    def end(self) -> Approach:
        """Return where the way has led."""
        self._wrong = 0.0
        self._judge()
        here = self._here
        sd = here.expected.deviation
        lines = self._lines()
        slope = lines.slope / sd[:, None]
        information = robust.positive(slope.T @ slope - float(np.sum(lines.scatter / sd**2)) * lines.chance)
        return Approach(
            self._model, self._slots, here.at, self._start, here.loss, self._seed, information, self._reach,
            self.cloud,
        )  # fmt: skip

    def _less_wrong(self, fell: float) -> None:
        """Let the model be less wrong where it is easily right enough, or short steps hardly make it better."""
        n = len(self._here.expected.value)
        still = fell < _STILL and self._reach < _SHORT
        while self._wrong and (still or self._here.loss < _EASY * n):
            self._wrong = self._turn.pop(0)
            self._judge()
            still, self._idle = False, 0
            self._reach = max(self._reach, _NEARBY)

    def _tries(self) -> list[Floats]:
        """Return places to which straight lines lead: with much, some, and none of the chance in them taken off."""
        here, of = self._here, self._problem.measured
        longest = self._reach * self._longest(here.at)
        low, high = (np.array([s.free.range[end] for s in self._slots]) for end in (0, 1))
        lines, sd = self._lines(), self._deviation(here.expected)
        scatter = lines.scatter / sd**2
        found = []
        for share in _SHARES:
            delta, _ = robust.solve(
                lines.slope / sd[:, None], (of.value - lines.value) / sd, self._precision, self._start - here.at,
                np.maximum(low - here.at, -longest), np.minimum(high - here.at, longest),
                chance=lambda w, share=share: share * float(w @ scatter) * lines.chance,  # type: ignore[misc]
            )  # fmt: skip
            found.append(here.at + delta)
        return found

    def _lines(self) -> Lines:
        """Return the lines about the best place; of what makes events later they are known for latencies."""
        here = self._here
        lines = self.cloud.lines(here.at, longest_of(self._slots, here.at), _WITHIN * self._reach)
        late = later(self._problem, here.expected)[:, None]
        lines.slope[:, self._offset] = late
        # A delay does more than that: the dead time begins later.
        lines.slope[:, self._delays] = np.where(late != 0.0, late, lines.slope[:, self._delays])
        lines.chance[self._offset, :] = 0.0
        lines.chance[:, self._offset] = 0.0
        return lines

    def _around(self, at: Floats, count: int) -> list[Floats]:
        """Return places around one; numbers that are held are tried, too: what they do must be known."""
        scale = np.where(self._offset, 0.0, longest_of(self._slots, at))
        known = known_beforehand(self._slots)
        scale[known] = np.minimum(scale[known], _OF_KNOWN / np.sqrt(self._precision[known]))
        return around(at, scale, _WITHIN * self._reach / math.sqrt(len(at)), count, self._rng)

    def _longest(self, at: Floats) -> Floats:
        longest = longest_of(self._slots, at)
        held = known_beforehand(self._slots) & (~self._offset | bool(self._wrong))
        return np.where(held, _AS_GOOD_AS_NONE * longest, longest)

    def _judge(self) -> None:
        """Work out all losses again."""
        self.cloud.places = [Place(p.at, p.expected, self.loss_at(p.expected, p.at)) for p in self.cloud.places]

    def _deviation(self, e: Expectation, wrong: float | None = None) -> Floats:
        wrong = self._wrong if wrong is None else wrong
        return np.hypot(e.deviation, e.tolerance(self._problem.measured, wrong)) if wrong else e.deviation

    def loss_at(self, e: Expectation, at: Floats, wrong: float | None = None) -> float:
        """Return the loss where something is expected, which may be so wrong."""
        residual = (self._problem.measured.value - e.value) / self._deviation(e, wrong)
        return robust.loss(residual) + float(np.sum(self._precision * (at - self._start) ** 2))
