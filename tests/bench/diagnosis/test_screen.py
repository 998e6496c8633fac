"""Scores of made-up directions: they are what linear regression says."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import norm

from bench.diagnosis.expected.catalogue import switches
from bench.diagnosis.expected.parameters import base_parameters, time_offset
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.fitting.fitted import Fit
from bench.diagnosis.fitting.probe import Probe
from bench.diagnosis.searching.screen import score
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects.registry import effects

N = 200
RNG = np.random.default_rng(5)
BASE = RNG.standard_normal((N, 2))


def fitted(residual: npt.NDArray[np.float64]) -> Fit:
    """Return a fit with two free numbers and this residual, of independent statistics of unit variance."""
    free = base_parameters(refractory_known=True)[:2]
    return Fit(
        model=PixelModel(), slots=tuple(Slot(f) for f in free), x=np.zeros(2), start=np.zeros(2), value=np.zeros(N),
        ratio=np.zeros(N), roots=(np.eye(N),), deviation=np.ones(N), jacobian=np.stack([BASE, BASE]), scale=1.0,
        residual=residual,
    )  # fmt: skip


PROBLEM = cast("Any", SimpleNamespace(measured=SimpleNamespace(points=(slice(0, N),))))


def probe_along(effect_id: str, *directions: npt.NDArray[np.float64]) -> Probe:
    """Return a probe of one size that moves the statistics along these directions, alike in both sensors."""
    effect = effects()[effect_id]
    change = np.stack(directions, axis=1)
    return Probe(effect, switches(effect), (1.0,) * len(directions), np.stack([change, change]))


LEAK, DARK, DRIFT = (10.0 * d / np.linalg.norm(d) for d in RNG.standard_normal((3, N)))


def test_the_effect_that_is_there_is_found_with_its_size() -> None:
    chance = RNG.standard_normal(N)
    fit = fitted(0.8 * LEAK + BASE @ np.array([0.2, -0.1]) + chance)
    scores = score(PROBLEM, fit, [probe_along("dark_current", DARK), probe_along("leak", LEAK)], seed=1)
    assert np.argmax(scores.drop) == 1
    # By hand: regression on the two free numbers and the direction.
    design = np.column_stack([BASE, LEAK])
    found, rest, *_ = np.linalg.lstsq(design, fit.residual, rcond=None)
    without = np.linalg.lstsq(BASE, fit.residual, rcond=None)[1]
    # Large residuals count less than their squares, by up to a tenth at two and a half standard errors.
    assert scores.drop[1] == pytest.approx(float(without[0] - rest[0]), rel=0.1)
    assert scores.size[1][0] == pytest.approx(found[2], rel=0.05)
    assert scores.p_best[1] < 1e-3


def test_a_number_that_does_nothing_does_not_hide_the_other_number_of_its_effect() -> None:
    """The mismatch of OFF thresholds where there are no OFF events."""
    both = probe_along("threshold_mismatch", LEAK, 0.0 * LEAK)
    assert score(PROBLEM, fitted(0.8 * LEAK), [both], seed=1).p_best[0] < 1e-3
    neither = probe_along("threshold_mismatch", 0.0 * LEAK, 0.0 * LEAK)
    assert score(PROBLEM, fitted(0.8 * LEAK), [neither], seed=1).p_best[0] == 1.0


def test_an_effect_of_the_wrong_sign_explains_nothing() -> None:
    fit = fitted(-0.8 * LEAK)
    scores = score(PROBLEM, fit, [probe_along("leak", LEAK)], seed=1)
    assert scores.drop[0] == 0.0
    assert scores.p_best[0] == 1.0
    signed = score(PROBLEM, fit, [probe_along("light_drift", LEAK)], seed=1)
    assert signed.size[0][0] == pytest.approx(-0.8, rel=0.05)


def test_what_the_free_numbers_can_do_is_no_effect() -> None:
    scores = score(PROBLEM, fitted(0.2 * BASE[:, 0]), [probe_along("leak", 0.1 * BASE[:, 0])], seed=1)
    assert scores.seen[0] < 0.1
    assert scores.drop[0] < 0.1  # what a loose prior of the free numbers leaves


def test_what_is_known_beforehand_takes_up_no_more_than_is_likely() -> None:
    """An effect in the direction of a known number shows by where that has gone: four standard deviations off."""
    free = replace(time_offset(1.0), highest=100.0)
    offset = Slot(free)
    column = LEAK[:, None]
    fit = replace(
        fitted(np.zeros(N)),
        slots=(offset,),
        x=np.array([4.0]),
        start=np.zeros(1),
        jacobian=np.stack([column, column]),
    )
    scores = score(PROBLEM, fit, [probe_along("leak", LEAK)], seed=1)
    assert scores.p_value[0] == pytest.approx(float(norm.sf(4.0)), rel=0.1)  # one-sided
    nearby = score(PROBLEM, replace(fit, x=np.array([1.0])), [probe_along("leak", LEAK)], seed=1)
    assert nearby.p_value[0] == pytest.approx(float(norm.sf(1.0)), rel=0.1)


def test_the_best_of_many_is_judged_among_many() -> None:
    """Under chance alone the p-value of the best of three is uniform, though each by itself is not."""
    probes = [probe_along("leak", LEAK), probe_along("dark_current", DARK), probe_along("light_drift", DRIFT)]
    runs = 100
    best = [score(PROBLEM, fitted(RNG.standard_normal(N)), probes, seed=1).p_best.min() for _ in range(runs)]
    below = np.mean(np.array(best) < 0.1)
    assert below == pytest.approx(0.1, abs=4.0 * np.sqrt(0.1 * 0.9 / runs))


def test_two_effects_with_one_direction_are_alike() -> None:
    scores = score(
        PROBLEM, fitted(LEAK), [probe_along("stray_light", 2.0 * LEAK), probe_along("dark_current", LEAK)], seed=1
    )
    assert scores.likeness[0, 1] == pytest.approx(1.0)
    apart = score(PROBLEM, fitted(LEAK), [probe_along("leak", LEAK), probe_along("dark_current", DARK)], seed=1)
    assert abs(apart.likeness[0, 1]) < 0.3


def test_what_another_effect_explains_is_no_sign_of_this_one() -> None:
    alike = LEAK + 2.0 * DARK / np.linalg.norm(DARK)
    probes = [probe_along("leak", LEAK), probe_along("dark_current", alike)]
    residual = 0.8 * LEAK + RNG.standard_normal(N)
    assert score(PROBLEM, fitted(residual), probes, seed=1).p_value[1] < 1e-4
    beside = score(PROBLEM, fitted(residual), probes, seed=1, beside=probes[:1])
    assert beside.p_value[0] == 1.0
    assert beside.p_value[1] > 1e-3


def test_far_off_the_loss_says_what_is_significant_not_the_squares_of_the_worst() -> None:
    """An effect that explains nearly all statistics, beside one statistic that is off by far, the other way."""
    residual = 5.0 * LEAK + RNG.standard_normal(N)
    worst = int(np.argmax(LEAK))
    residual[worst] = -1e4
    probes = [probe_along("leak", LEAK), probe_along("dark_current", DARK)]
    squares, loss = (score(PROBLEM, fitted(residual), probes, seed=1, far_off=far) for far in (False, True))
    assert squares.p_best[0] > 0.1
    assert loss.p_best[0] < 1e-3
    assert loss.p_best[1] > 0.01
