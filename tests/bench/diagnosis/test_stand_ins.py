"""An effect that takes away what comes back on points that the fit did not see stands in for something else."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.expected.catalogue import free_of
from bench.diagnosis.expected.parameters import base_parameters, time_offset
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.fitting.fitted import Fit
from bench.diagnosis.fitting.judging import deviance, freedom, heldout, is_far_off, loss_left
from bench.diagnosis.searching.refit import Found
from bench.diagnosis.searching.state import may_be_added
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects.leak import Leak

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

POINTS, EACH = 40, 20
N = POINTS * EACH
SLICES = tuple(slice(i * EACH, (i + 1) * EACH) for i in range(POINTS))
PROBLEM: Any = SimpleNamespace(measured=SimpleNamespace(points=SLICES), forward=SimpleNamespace(dt_s=1e-5))
BASE, LEAK = Slot(base_parameters(refractory_known=True)[0]), Slot(free_of(Leak)[0])
RNG = np.random.default_rng(12)
NOISE, COLUMN = RNG.standard_normal(N), RNG.standard_normal(N)


def fit_of(measured: Floats, *changes: Floats) -> Fit:
    """Return the fit, by least squares, of numbers that change what is expected by so much."""
    columns = np.column_stack([COLUMN, *changes])
    x = np.asarray(np.linalg.lstsq(columns, measured, rcond=None)[0], np.float64)
    return Fit(
        model=PixelModel() + Leak(rate_per_s=1.0) if changes else PixelModel(), slots=(BASE, LEAK)[: len(x)], x=x,
        start=np.zeros(len(x)), value=columns @ x, ratio=np.zeros(N), roots=(np.eye(EACH),) * POINTS,
        deviation=np.ones(N), jacobian=np.stack([columns, columns]), scale=1.0, residual=measured - columns @ x,
    )  # fmt: skip


def is_added(measured: Floats, change: Floats) -> bool:
    """Return whether an effect that does this may be added to a model without it."""
    found = fit_of(measured, change)
    return may_be_added(PROBLEM, fit_of(measured), Found("leak", found, deviance(PROBLEM, found)))


def test_what_all_points_show_may_be_added() -> None:
    change = np.abs(RNG.standard_normal(N))
    assert is_added(NOISE + 0.3 * change, change)
    assert is_added(NOISE + 2.0 * change, change)


def test_what_takes_away_something_else_where_it_can_stands_in_for_it() -> None:
    """It does something in a few points that have little to do with each other, and would in others."""
    wrong = np.zeros(N)
    for where in SLICES[::4]:
        wrong[where] = 2.0 * RNG.standard_normal(EACH)
    change = np.abs(RNG.standard_normal(N)) * 0.2
    change[SLICES[0]] = 5.0 * wrong[SLICES[0]]
    assert not is_added(NOISE + wrong, change)


def test_what_leaves_hardly_anything_may_be_seen_in_one_point_alone() -> None:
    change = np.zeros(N)
    change[SLICES[7]] = 10.0 + RNG.standard_normal(EACH)
    assert is_added(NOISE + change, change)


def test_one_point_alone_tells_nothing_of_points_that_were_not_seen() -> None:
    """There it is no reason to refuse an effect."""
    problem: Any = SimpleNamespace(measured=SimpleNamespace(points=(slice(0, N),)), forward=PROBLEM.forward)
    change = np.abs(RNG.standard_normal(N))
    measured = NOISE + 0.3 * change
    before, after = (replace(fit_of(measured, *more), roots=(np.eye(N),)) for more in ([], [change]))
    assert math.isnan(heldout(problem, before))
    assert may_be_added(problem, before, Found("leak", after, deviance(problem, after)))


KNOWN = replace(BASE.free, prior_sd=0.05)
START, MEASURED = np.array([-0.2]), NOISE + 0.6 * COLUMN


def least_squares(seen: npt.NDArray[np.int64]) -> float:
    """Return the number that some of the statistics ask for, given what is known before."""
    known = KNOWN.prior_sd**-2
    return float((COLUMN[seen] @ MEASURED[seen] + START[0] * known) / (COLUMN[seen] @ COLUMN[seen] + known))


def test_points_that_were_not_seen_are_foreseen_with_what_is_known_beforehand() -> None:
    """Each fold by itself: least squares with a prior, whose middle is not where the fit has led."""
    x = np.array([least_squares(np.arange(N))])
    one = replace(
        fit_of(MEASURED), slots=(Slot(KNOWN),), x=x, start=START, residual=MEASURED - COLUMN * x[0]
    )  # fmt: skip
    squares = 0.0
    for fold in range(5):
        unseen = np.concatenate([np.arange(N)[where] for where in SLICES[fold::5]])
        there = least_squares(np.setdiff1d(np.arange(N), unseen))
        squares += float(np.sum((MEASURED[unseen] - there * COLUMN[unseen]) ** 2))
    assert heldout(PROBLEM, one) == pytest.approx(squares / N, rel=1e-9)


def test_a_clock_that_is_off_is_a_residual_of_its_own() -> None:
    """What is known of it is an observation: its square counts, and it is one of the degrees of freedom."""
    plain = fit_of(MEASURED)
    sd = 1e-5
    late = np.zeros((2, N, 2))
    late[:, :, 0] = plain.jacobian[:, :, 0]  # the clock itself changes nothing
    slots, x = (BASE, Slot(time_offset(sd))), np.array([plain.x[0], 3.0 * sd])
    off = replace(plain, slots=slots, x=x, start=np.zeros(2), jacobian=late)
    assert deviance(PROBLEM, off) == pytest.approx(deviance(PROBLEM, plain) + 9.0)
    assert loss_left(PROBLEM, off) == pytest.approx(loss_left(PROBLEM, plain) + 9.0)
    assert freedom(off) == freedom(plain)  # a number more, and an observation more
    assert heldout(PROBLEM, off) == pytest.approx((N * heldout(PROBLEM, plain) + 9.0) / (N + 1))


def test_unseen_points_are_no_better_than_all_where_lines_lead_to_what_simulations_have_refused() -> None:
    """A fit that stopped elsewhere than straight lines ask for: they would foresee what no simulation shows."""
    x = np.array([1.6])
    one = replace(fit_of(MEASURED), x=x, residual=MEASURED - COLUMN * x[0])
    fitted = fit_of(MEASURED)
    assert heldout(PROBLEM, fitted) < 1.1 * deviance(PROBLEM, fitted) / N
    assert heldout(PROBLEM, one) > 0.9 * deviance(PROBLEM, one) / N > 1.5 * heldout(PROBLEM, fitted)


@pytest.mark.parametrize(("points", "far_off"), [(10, False), (39, True), (100, True)])
def test_what_is_far_off_depends_on_how_many_statistics_say_so(points: int, far_off: bool) -> None:
    """An error of 1.35 is 1.4, 2.7 and 4.4 standard deviations of chance in 20, 780 and 2000 of them, with 1.25."""
    n = points * EACH
    problem: Any = SimpleNamespace(measured=SimpleNamespace(points=[slice(0, n)]))
    residual = np.full(n, math.sqrt(1.35))
    one: Any = SimpleNamespace(
        residual=residual,
        roots=(np.eye(n),),
        slots=(),
        x=np.zeros(0),
        start=np.zeros(0),
        caution=1.0,
        scale=1.0,
        whiten=lambda r, _: r,
    )
    assert is_far_off(problem, one) is far_off
