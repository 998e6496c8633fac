"""Trends in residuals whose law is known."""

from __future__ import annotations

from itertools import product
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.stats import binom

from bench.diagnosis.expected.parameters import base_parameters
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.fitting.fitted import Fit
from bench.diagnosis.recorded.summary import Label
from bench.diagnosis.searching.state import leaves_little
from bench.diagnosis.searching.trends import Trend, clear_trends
from sim_backend.pixel import PixelModel

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

VIEWS = ("response", "latency", "latency_spread", "second_event", "background", "locked")
LIGHTS, CONTRASTS = (0.0, 1.0, 30.0, 100.0), (0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0)
LABELS = tuple(
    Label(0, view, part, "mean", "", lux, contrast, 0.02, 0.0, 1.0, False, False)  # type: ignore[arg-type]
    for view, part, lux, contrast in product(VIEWS, ("on", "off"), LIGHTS, CONTRASTS)
)
N = len(LABELS)


class Bench:
    """A run whose sensors are known by what they show: chance, and what all points of a sensor have in common."""

    def __init__(self, frozen: Floats | None = None) -> None:
        self.measured = SimpleNamespace(points=(slice(0, N),), labels=LABELS)
        self._frozen = np.zeros(N) if frozen is None else frozen
        self.simulated = 0

    def sensor(self, draw: np.random.Generator) -> Floats:
        return draw.standard_normal(N) + self._frozen * draw.standard_normal()

    def models(self, *_: object) -> list[PixelModel]:
        return [PixelModel()]

    def cost(self, _: object) -> float:
        return 1.0

    def whole_sensors(self, _: object, seed: int, number: int) -> list[Floats]:
        self.simulated += number
        draw = np.random.default_rng([seed, 99])
        return [self.sensor(draw) for _ in range(number)]

    def expect(self, sensors: list[Floats]) -> SimpleNamespace:
        return SimpleNamespace(value=sensors[0], said=np.ones(len(sensors[0]), np.bool_))


def trends(one: Fit, bench: Bench | None = None) -> tuple[Trend, ...]:
    problem: Any = bench or Bench()
    return clear_trends(problem, one, seed=1)


def fitted(residual: Floats, taken_up: Floats | None = None, common: float = 1.0) -> Fit:
    """Return a fit; what it can take up are the changes by one free number."""
    k = 0 if taken_up is None else 1
    column = np.zeros((N, 0)) if taken_up is None else taken_up[:, None]
    slots = tuple(Slot(free) for free in base_parameters(refractory_known=False)[:k])
    return Fit(
        model=PixelModel(), slots=slots, x=np.zeros(k), start=np.zeros(k),
        value=np.zeros(N), ratio=np.zeros(N), roots=(np.eye(N),), deviation=np.ones(N),
        jacobian=np.stack([column, column]), scale=1.0, residual=residual, common=common,
    )  # fmt: skip


def of(view: str, part: str) -> Floats:
    return np.array([float(label.view == view and label.part == part) for label in LABELS])


@pytest.fixture
def chance() -> Floats:
    return np.random.default_rng(5).standard_normal(N)


def test_chance_makes_no_trend() -> None:
    """Of 300 runs of a true model 3 are expected to have any; more than 10 would be by a chance of 1 in 5000."""
    draw = np.random.default_rng(1)
    found = sum(bool(trends(fitted(draw.standard_normal(N)))) for _ in range(300))
    assert found <= binom.isf(2e-4, 300, 0.01)


def test_nothing_is_simulated_where_there_is_none(chance: Floats) -> None:
    bench = Bench()
    assert trends(fitted(chance), bench) == ()
    assert bench.simulated == 0


def test_what_is_frozen_in_the_pixels_makes_no_trend() -> None:
    """From sensor to sensor all latencies go up or down together; 1 in 40 goes so far that 4 sigma are seen."""
    bench, draw = Bench(of("latency", "off")), np.random.default_rng(2)
    runs = [fitted(bench.sensor(draw)) for _ in range(200)]
    plain, aware = (sum(bool(trends(one, b)) for one in runs) for b in (Bench(), bench))
    assert plain > 60  # a sum of 28 statistics varies by 5.4 instead of 1
    assert aware <= binom.isf(2e-4, 200, 0.02)  # how it varies is known from 24 sensors, not perfectly


def test_what_is_off_by_a_standard_error_everywhere_is_seen(chance: Floats) -> None:
    """The 28 statistics together are off by 5.3 standard errors; a sum of 336 squares is larger by 1.6 only."""
    one = fitted(chance - 1.3 * of("latency", "off"))
    first = trends(one)[0]
    assert (first.axis, first.where) == ("view", "latency off")
    assert first.z == pytest.approx(-1.3 * np.sqrt(28), abs=3.0)
    assert first.size == pytest.approx(1.3, abs=3.0 / np.sqrt(28))
    problem: Any = Bench()
    assert leaves_little(problem, one)


@pytest.mark.parametrize(
    ("shape", "axis", "where"),
    [
        ([-1.5, -0.5, 0.5, 1.5], "illuminance", "second_event on, along it"),
        ([3.0, 0.0, 0.0, 0.0], "illuminance", "second_event on at 0 lux"),
    ],
)
def test_where_it_is_off_is_told(chance: Floats, shape: list[float], axis: str, where: str) -> None:
    by_light = np.array([shape[LIGHTS.index(label.baseline_lux)] for label in LABELS])
    first = trends(fitted(chance + by_light * of("second_event", "on")))[0]
    assert (first.axis, first.where) == (axis, where)


def test_what_a_free_number_takes_up_is_no_trend(chance: Floats) -> None:
    off = of("latency", "off")
    assert trends(fitted(chance + 1.3 * off))
    assert not trends(fitted(chance + 1.3 * off, taken_up=off))


def test_what_is_looked_at_where_the_run_says_is_no_trend(chance: Floats) -> None:
    """At the phase that a run has by chance, something goes with any ripple."""
    assert not trends(fitted(chance + 1.5 * of("locked", "on")))


def test_points_that_were_simulated_as_one_have_chance_in_common(chance: Floats) -> None:
    residual = chance + 1.3 * of("latency", "off")
    plain, common = (trends(fitted(residual, common=c)) for c in (1.0, 1.44))
    assert common[0].z == pytest.approx(plain[0].z / 1.2)


def test_a_fit_of_nothing_has_none() -> None:
    unknown = Fit(
        model=PixelModel(), slots=(), x=np.zeros(0), start=np.zeros(0), value=np.zeros(N), ratio=np.zeros(N),
        roots=(np.zeros((N, N)),), deviation=np.full(N, 1e6), jacobian=np.zeros((2, N, 0)), scale=1.0,
        residual=np.zeros(N),
    )  # fmt: skip
    assert trends(unknown) == ()
