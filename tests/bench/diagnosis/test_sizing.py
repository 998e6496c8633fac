"""Gross effects are probed at the size that they promise: there some do nothing."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.expected.catalogue import switches
from bench.diagnosis.expected.parameters import base_parameters
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.fitting.explaining import explain
from bench.diagnosis.fitting.fitted import Fit
from bench.diagnosis.fitting.probe import Probe
from bench.diagnosis.searching import probing, sizing
from bench.diagnosis.searching.probing import well_sized
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects.registry import effects

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sim_backend.pixel.effects.base import Effect

    Floats = npt.NDArray[np.float64]

N = 200
RNG = np.random.default_rng(5)
LEAK, CROSSTALK = effects()["leak"], effects()["crosstalk"]
DIRECTION = 10.0 * np.ones(N)
PROBLEM: Any = SimpleNamespace(measured=SimpleNamespace(points=(slice(0, N),)))


def fit_with(residual: Floats) -> Fit:
    """Return a fit with one free number that does something else, and this residual of unit variance."""
    free = base_parameters(refractory_known=True)[:1]
    other = RNG.standard_normal((N, 1))
    return Fit(
        model=PixelModel(), slots=tuple(Slot(f) for f in free), x=np.zeros(1), start=np.zeros(1), value=np.zeros(N),
        ratio=np.zeros(N), roots=(np.eye(N),), deviation=np.ones(N), jacobian=np.stack([other, other]), scale=1.0,
        residual=residual,
    )  # fmt: skip


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, float]]:
    """Effects by hand: a leak does the more the larger it is, crosstalk nothing below half of the usual size."""
    calls: list[tuple[str, float]] = []

    def done(effect: type[Effect], factor: float) -> Floats:
        return np.asarray(DIRECTION * (factor if effect is LEAK else 1.1 * factor * (factor > 0.5)))

    def probes_at(_: Any, __: Any, wanted: Sequence[tuple[type[Effect], Sequence[float]]], *___: Any) -> list[Probe]:
        found = []
        for effect, sizes in wanted:
            calls.append((effect.id, sizes[0]))
            (free,) = switches(effect)
            change = np.stack([done(effect, sizes[0])[:, None]] * 2)
            found.append(Probe(effect, (free,), (free.coordinate(free.probe) * sizes[0],), change))
        return found

    monkeypatch.setattr(probing, "probes_at", probes_at)
    monkeypatch.setattr(sizing, "probes_at", probes_at)
    return calls


def test_what_does_nothing_in_the_size_that_it_promises_is_found_out(asked: list[tuple[str, float]]) -> None:
    fit = fit_with(0.25 * DIRECTION)
    leak, crosstalk = sizing.probe(PROBLEM, fit, [LEAK, CROSSTALK], 1, True, {})
    columns, residual = fit.jacobian[0], fit.residual
    # From afar both promise all of it, at a quarter and a little less of the usual size.
    assert {("leak", 1.0), ("crosstalk", 1.0)} <= set(asked)
    assert explain(fit, columns, residual, leak)[1][0] == pytest.approx(0.25 * switches(LEAK)[0].probe, rel=0.01)
    # It is to be seen: by 25 standard errors, of 5 at the most in each statistic.
    assert leak.at[0] == pytest.approx(25.0 / (5.0 * np.sqrt(N)) * switches(LEAK)[0].probe, rel=0.01)
    assert np.all(crosstalk.change == 0.0)


def test_a_probe_is_tried_until_it_is_of_the_wanted_size(asked: list[tuple[str, float]]) -> None:
    """A quarter moves each of 200 statistics by 2.5, some 35 standard errors in all, of which 25 are wanted.

    What the free number can take up of it is not seen.
    """
    known: dict[tuple[str, str], float] = {}
    fit = fit_with(np.zeros(N))
    fit = replace(fit, jacobian=fit.jacobian + 1.0)  # half of what it does is what the leak does
    well_sized(PROBLEM, fit, [LEAK], 1, 0.1, known)
    assert asked[0] == ("leak", 0.25)
    other = fit.jacobian[0][:, 0] / np.linalg.norm(fit.jacobian[0])
    seen = float(np.linalg.norm(DIRECTION - other * (other @ DIRECTION)))
    assert seen < 0.8 * 10.0 * np.sqrt(N)
    assert known[("leak", "rate_per_s")] == pytest.approx(seen, rel=0.01)
    # What was found out is known the next time.
    well_sized(PROBLEM, fit, [LEAK], 1, 0.1, known)
    assert asked[1][1] == pytest.approx(25.0 / seen, rel=0.01)
    assert len(asked) == 2


def test_what_stood_out_by_chance_is_asked_again_in_a_larger_size(
    asked: list[tuple[str, float]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A hundredth of a leak moves 200 statistics by a tenth each, 1.4 standard errors in all; it seemed to be 100."""
    fit = fit_with(0.2 * DIRECTION)
    usual = switches(LEAK)[0].probe
    seemed = Probe(LEAK, switches(LEAK), (0.01 * usual,), np.stack([0.7 * DIRECTION[:, None]] * 2))
    monkeypatch.setattr(sizing, "well_sized", lambda *_: [seemed])
    (leak,) = sizing.probe(PROBLEM, fit, [LEAK], 1, False, {})
    assert asked[0][1] == pytest.approx(0.01)
    # Its line explains two standard errors of each statistic, some 28 in all: that many are wanted.
    wanted = leak.at[0] / usual * float(np.linalg.norm(DIRECTION))
    assert wanted == pytest.approx(np.sqrt(0.2**2 * 100.0 * N - N), rel=0.05)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("gross", [True, False])
def test_an_effect_of_either_sign_is_probed_in_the_one_that_explains_more(
    monkeypatch: pytest.MonkeyPatch, sign: float, gross: bool
) -> None:
    """By hand: rising light does one thing, falling light another."""
    drift = effects()["light_drift"]
    rising, falling = np.where(np.arange(N) % 2, 10.0, 0.0), np.where(np.arange(N) % 2, 0.0, 10.0)

    def probes_at(_: Any, __: Any, wanted: Sequence[tuple[type[Effect], Sequence[float]]], *___: Any) -> list[Probe]:
        found = []
        for effect, (size,) in wanted:
            (free,) = switches(effect)
            change = np.stack([((rising if size > 0.0 else falling) * abs(size))[:, None]] * 2)
            found.append(Probe(effect, (free,), (free.coordinate(free.probe) * size,), change))
        return found

    monkeypatch.setattr(probing, "probes_at", probes_at)
    monkeypatch.setattr(sizing, "probes_at", probes_at)
    fit = fit_with(0.25 * (rising if sign > 0.0 else falling))
    (one,) = sizing.probe(PROBLEM, fit, [drift], 1, gross, {})
    assert np.sign(one.at[0]) == sign
    expected = explain(fit, fit.jacobian[0], fit.residual, one)[1][0]
    assert expected == pytest.approx(sign * 0.25 * switches(drift)[0].probe, rel=0.02)


def test_what_is_gross_at_one_size_promises_something_at_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """By hand: a queue does one thing as long as it is short, and another that hides it where it is long."""
    short, long = np.where(np.arange(N) % 2, 10.0, 0.0), np.where(np.arange(N) % 2, 0.0, 10.0)

    def probes_at(_: Any, __: Any, wanted: Sequence[tuple[type[Effect], Sequence[float]]], *___: Any) -> list[Probe]:
        found = []
        for effect, (size,) in wanted:
            (free,) = switches(effect)
            change = np.stack([(short * size + (long * size if size > 0.2 else 0.0))[:, None]] * 2)
            found.append(Probe(effect, (free,), (free.coordinate(free.probe) * size,), change))
        return found

    monkeypatch.setattr(probing, "probes_at", probes_at)
    (gross,) = probes_at(None, None, [(LEAK, (1.0,))])
    fit = fit_with(0.1 * short)
    (one,) = sizing.at_other_sizes(PROBLEM, fit, [gross], 1)
    assert one.at[0] == pytest.approx(0.1 * switches(LEAK)[0].probe)
    assert explain(fit, fit.jacobian[0], fit.residual, one)[1][0] == pytest.approx(one.at[0], rel=0.02)
    fit = fit_with(short + long)
    (one,) = sizing.at_other_sizes(PROBLEM, fit, [gross], 1)
    assert one is gross


@pytest.mark.parametrize(
    ("name", "at", "sizes"),
    [
        ("leak", 1.0, (0.1, 0.3, 3.0)),
        ("light_drift", 1.0, (0.1, 0.3, 3.0, -0.1, -0.3, -3.0)),
        ("light_drift", 10.0, (0.1, 0.3, -0.1, -0.3)),  # 0.9 by the second is beyond what is believed
        ("hot_pixels", 1.0, (3.0,)),  # of a smaller share there may be none
    ],
)
def test_other_sizes_are_within_bounds(name: str, at: float, sizes: tuple[float, ...]) -> None:
    effect = effects()[name]
    numbers = tuple(free.coordinate(free.probe) * at for free in switches(effect))
    assert sizing._factors(Probe(effect, switches(effect), numbers, np.zeros((2, 1, len(numbers))))) == sizes
