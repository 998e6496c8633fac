"""The phase of a ripple is read off the events of each recording; the ripple is the simulator's own."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis import session as session_module
from bench.diagnosis.expected.parameters import base_parameters
from bench.diagnosis.expected.phases import phases_of, with_phases
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.fitting import in_phase as in_phase_module
from bench.diagnosis.fitting import phase_search
from bench.diagnosis.fitting.phase_search import sharper_phases
from bench.diagnosis.recorded.recording import Frame, Recording
from bench.diagnosis.recorded.ripple import locked, with_ripple
from bench.diagnosis.recorded.summary import summarise
from bench.diagnosis.session import open_session
from bench.diagnosis.views.locked import Locked, LockedAcross
from bench.models.simulation import on_sensor
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects import LightFlicker

if TYPE_CHECKING:
    from collections.abc import Callable

PIXEL = PixelModel(noise_rms=0.045, corner_hz=150.0, theta_on=0.3, theta_off=0.25, refractory_s=8e-3)
RIPPLE = LightFlicker(depth=0.05, frequency_hz=61.7)


def points(point: Callable[..., Any]) -> list[Any]:
    """Return square waves of two periods, at contrasts of which not all pulses are answered."""
    found = [point(i, contrast, periods=24, half_s=0.05) for i, contrast in enumerate((0.2, 0.26, 0.3))]
    return found + [point(3 + i, contrast, periods=24, half_s=0.037) for i, contrast in enumerate((0.22, 0.28))]


@pytest.mark.parametrize("phase", [0.4, 3.3])
def test_the_phase_is_found(point: Callable[..., Any], run_of: Callable[..., Any], phase: float) -> None:
    """64 pixels and 48 pulses: a phase is known to about a tenth of a radian."""
    run = run_of(points(point), PIXEL + replace(RIPPLE, phase=phase), 5)
    taken = list(run.points())
    models = [on_sensor(PIXEL, run.header.sensor)] * len(taken)
    found = np.array(phases_of(taken, models, RIPPLE, 2e-5, seed=9))
    apart = np.angle(np.exp(1j * (found - phase)))
    assert np.max(np.abs(apart)) < 0.5
    assert abs(float(np.mean(apart))) < 0.2


@pytest.mark.parametrize("phase", [1.1, 4.0])
def test_a_ripple_at_the_same_phase_of_every_pulse_shows_in_the_answers(
    point: Callable[..., Any], run_of: Callable[..., Any], phase: float
) -> None:
    """60 Hz beside pulses of 10 Hz: six of its periods to each of theirs."""
    ripple = replace(RIPPLE, frequency_hz=60.0)
    asked = [point(i, contrast, periods=24, half_s=0.05) for i, contrast in enumerate((0.2, 0.26, 0.3, 0.5))]
    run = run_of(asked, PIXEL + replace(ripple, phase=phase), 5)
    assert [locked(taken, 60.0) for taken in run.points()] == [None] * 4
    with open_session([run]) as session:
        problem = replace(session.problem, phases=(None,) * 4)
        model = on_sensor(PIXEL + ripple, run.header.sensor)
        slots = problem.slots_of(model)
        x = np.array(problem.starts(model, by_eye=False)[0])
        statistics = len(problem.measured.labels)
        still: Any = SimpleNamespace(
            model=model, slots=slots, x=x, start=x, jacobian=np.zeros((2, statistics, len(x))),
            value=np.zeros(statistics), known=np.zeros(statistics, np.bool_),
            models=lambda there: there.models(model, slots, x),
        )  # fmt: skip
        turned = sharper_phases(problem, still, seed=9)
        assert turned.x == pytest.approx(x)
        assert None not in turned.phases
        assert np.max(np.abs(np.angle(np.exp(1j * (np.array(turned.phases, np.float64) - phase))))) < 0.8
        again = sharper_phases(replace(problem, phases=(phase,) * 4), still, seed=9)
        assert again.phases.count(phase) >= 2


def test_what_a_fit_expects_at_its_phases_is_kept_and_goes_on_from_there_with_the_phase() -> None:
    """What is simulated at other phases has a constant error; where the fit knows nothing, it is all there is."""
    search = object.__new__(phase_search._Search)
    search._fine = 2.0 * math.pi * np.arange(256) / 256
    search._problem = SimpleNamespace(phases=(1.0,), measured=SimpleNamespace(points=(slice(0, 2),)))  # type: ignore[assignment]
    search._fitted = SimpleNamespace(  # type: ignore[assignment]
        value=np.array([3.0, 9.0]), known=np.array([True, False]), jacobian=np.ones((2, 2, 1))
    )
    simulated = np.stack([np.sin(search._fine) + 0.5, np.cos(search._fine)], -1)
    search._expected = search._anchored(simulated)
    here, there = search._place(1.0), search._place(2.0)
    assert search._expected[here] == pytest.approx([3.0, math.cos(search._fine[here])])
    moved = search.expected((2.0,), np.array([0.25]))
    assert moved[0] == pytest.approx(3.25 + math.sin(search._fine[there]) - math.sin(search._fine[here]))
    assert search.expected((None,), np.zeros(1)) == pytest.approx(search._fitted.value)
    # A phase that was open: the fit says nothing of any.
    search._problem = SimpleNamespace(phases=(None,), measured=search._problem.measured)  # type: ignore[assignment]
    search._expected = search._anchored(simulated)
    assert search.expected((2.0,), np.array([0.25])) == pytest.approx(simulated[there] + 0.25)


def test_phases_and_numbers_that_hold_on_to_each_other_are_found_together() -> None:
    """What a number does is nearly what a turn of all phases does; only a last statistic tells them apart."""
    truth, number = np.array([0.5, 2.0, 4.0]), 0.2
    fine = 2.0 * math.pi * np.arange(256) / 256
    free = base_parameters(refractory_known=True)[0]
    turned = object.__new__(phase_search._Search)
    turned._fine = fine
    turned._problem = SimpleNamespace(phases=tuple(truth + number))  # type: ignore[assignment]
    turned._fitted = SimpleNamespace(slots=(Slot(free),), x=np.zeros(1), start=np.zeros(1))  # type: ignore[assignment]

    def seen(phase: Any, moved: float) -> Any:
        """A hundred standard errors from crest to trough, five for the number."""
        return np.stack([50.0 * np.cos(phase + moved), 50.0 * np.sin(phase + moved), 5.0 * moved + 0.0 * phase], -1)

    small = 1e-6
    turned._residual = [seen(phase, number) - seen(fine, 0.0) for phase in truth]
    turned._changes = [((seen(fine, small) - seen(fine, 0.0)) / small)[:, :, None]] * len(truth)
    phases, moved = turned._problem.phases, np.zeros(1)
    for _ in range(4):
        moved = turned.numbers(phases)
        phases = turned.phases(moved)
    assert moved[0] == pytest.approx(number, abs=0.02)
    assert np.max(np.abs(np.array(phases, np.float64) - truth)) < 0.06


def test_a_ripple_whose_phase_is_open_gets_that_of_the_point() -> None:
    models = [PIXEL + RIPPLE, PIXEL + replace(RIPPLE, phase=1.0), PIXEL]
    found = with_phases(models, [2.0, 2.0, 2.0])
    assert found == [PIXEL + replace(RIPPLE, phase=2.0), PIXEL + replace(RIPPLE, phase=1.0), PIXEL]


def test_events_on_the_crest_of_a_ripple_are_locked_to_it(
    point: Callable[..., Any], recorded: Callable[..., Any]
) -> None:
    """An ON event in every other period of 10 ms, at the same phase: all of their rate goes with the ripple."""
    taken = recorded(point(0, 0.0), [(1_000 + 20_000 * k, k % 8, 0, 1) for k in range(250)])
    hz, seconds, pixels = 100.0, 5.0, 64
    crest = -2.0 * math.pi * hz * 1e-3
    marked = replace(taken, attributes={"ripple_hz": hz, "ripple_on_rad": crest, "ripple_off_rad": 0.0})
    off, on = Locked().look(Recording(Frame(marked), marked.events()))
    # Eight bins for each period: an event may be half a bin away from where it is counted.
    assert float(on.top.sum() / on.bottom.sum()) == pytest.approx(250 / (seconds * pixels), rel=0.08)
    assert not off.top.any()
    _, across = LockedAcross().look(Recording(Frame(marked), marked.events()))
    assert abs(float(across.top.sum())) < 0.4 * float(on.top.sum())
    turned = replace(marked, attributes={**marked.attributes, "ripple_on_rad": crest - 0.5 * math.pi})
    _, across = LockedAcross().look(Recording(Frame(turned), turned.events()))
    assert float(across.top.sum()) == pytest.approx(float(on.top.sum()))


def test_without_a_ripple_nothing_is_said(point: Callable[..., Any], run_of: Callable[..., Any]) -> None:
    taken = list(run_of(points(point), PIXEL, 5).points())
    assert with_ripple(taken) == taken
    assert summarise(Recording(Frame(taken[0]), taken[0].events()), (Locked(),)).labels == ()


class FollowedInTurns:
    """Phases that come closer in each round, as the errors of each beginning say, and fits that know of the last."""

    def __init__(self, errors: dict[float | None, dict[tuple[float, ...], float]]) -> None:
        self.errors, self.fitted = errors, 0

    def sharper_phases(self, problem: Any, found: Any, _: int) -> Any:
        best = min(self.errors[beginning(found)])
        value = np.zeros(1)
        return SimpleNamespace(phases=(max(problem.phases[0] - 1.0, best[0]),), x=np.zeros(1), value=value)

    def moved(self, _: Any, found: Any, x: Any, __: int) -> Any:
        return replace(found, x=x)

    def finish(self, _: Any, near: Any) -> Any:
        self.fitted += 1
        return near

    def error(self, problem: Any, found: Any) -> float:
        return self.errors[beginning(found)].get(problem.phases, 9.0)


def beginning(found: Any) -> float | None:
    """Return the corner behind which pixels have settled to the ripple."""
    return next(e for e in found.model.effects if isinstance(e, LightFlicker)).settled_hz


FALLS = {(3.0,): 9.0, (2.0,): 4.0, (1.0,): 1.0}
FALLS_TOO = {(3.0,): 9.0, (2.0,): 4.0, (1.0,): 0.97}
FALLS_FURTHER = {(3.0,): 9.0, (2.0,): 4.0, (1.0,): 0.5}
STAYS = {(3.0,): 9.0, (2.0,): 8.9}
LITTLE = {(3.0,): 1.0, (2.0,): 0.9, (1.0,): 0.8}
FAR_OFF = {(3.0,): 20.0, (2.0,): 0.1}


@pytest.mark.parametrize(("before", "errors", "end", "begun", "fits"), [
    (None, {None: FALLS, 150.0: STAYS, 1e-3: FAR_OFF}, 1.0, None, 1),
    (None, {None: FALLS, 150.0: FALLS_TOO, 1e-3: FAR_OFF}, 1.0, None, 1),  # no better than by chance
    (None, {None: FALLS, 150.0: FALLS_FURTHER, 1e-3: FAR_OFF}, 1.0, 150.0, 1),
    (None, {None: STAYS, 150.0: STAYS, 1e-3: FAR_OFF}, 3.0, None, 0),
    (1e-3, {1e-3: FALLS, None: STAYS, 150.0: FALLS_FURTHER}, 1.0, 150.0, 1),  # it had stood in for something else
    (1e-3, {1e-3: LITTLE}, 1.0, 1e-3, 1),  # no more is left than chance leaves: it is not asked again
])  # fmt: skip
def test_phases_and_numbers_are_followed_and_fitted_once(
    monkeypatch: pytest.MonkeyPatch, before: float | None, errors: Any, end: float, begun: float | None, fits: int
) -> None:
    """Each round is judged by what is simulated; what makes the error hardly smaller is left."""
    turns = FollowedInTurns(errors)
    for name in ("sharper_phases", "moved", "finish"):
        monkeypatch.setattr(in_phase_module, name, getattr(turns, name))
    monkeypatch.setattr(in_phase_module, "approach", lambda _, model, *__, **___: replace(found, model=model))
    monkeypatch.setattr(in_phase_module, "deviance_per_dof", turns.error)
    monkeypatch.setattr(in_phase_module, "leaves_more_than_chance", lambda *of: turns.error(*of) > 1.0)
    monkeypatch.setattr(session_module.Session, "in_time", lambda _, found, __: found)
    session = object.__new__(session_module.Session)
    session.problem = Phases((3.0,), {LightFlicker.id: {"frequency_hz": 61.7}})  # type: ignore[assignment]
    found: Any = Found(PIXEL + replace(RIPPLE, settled_hz=before))
    fitted = session.in_phase(found, seed=1)
    assert session.problem.phases == (end,)
    assert beginning(fitted) == begun
    assert turns.fitted == fits
    assert (fitted is found) == (not fits)


@dataclass(frozen=True)
class Found:
    """As much of a fit as is asked for."""

    model: PixelModel
    slots: tuple[Any, ...] = ()
    x: Any = field(default_factory=lambda: np.ones(1))
    start: Any = field(default_factory=lambda: np.ones(1))
    value: Any = None
    residual: Any = None


@dataclass(frozen=True)
class Phases:
    """What a session knows of a ripple."""

    phases: tuple[float, ...]
    given: dict[str, dict[str, float]]
    measured: Any = field(default_factory=lambda: SimpleNamespace(value=np.zeros(1)))

    def of_settings(self, model: PixelModel, _: Any, __: Any) -> list[PixelModel]:
        return [model]
