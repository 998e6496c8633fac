"""The loop of a diagnosis: what was added and taken out again does not come back."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.diagnosis import Diagnosis
from bench.diagnosis.expected.parameters import Free
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.fitting.fitted import Fit
from bench.diagnosis.searching import state, taking_out
from bench.diagnosis.searching.refit import needless
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects import DarkCurrent, HotPixels, Leak

if TYPE_CHECKING:
    from collections.abc import Collection


class Wavering(Diagnosis):
    """Proposes effects in turn; each takes the one before out again."""

    def __init__(self, proposals: list[str | None]) -> None:
        self.proposals = proposals
        self.added: list[str] = []
        self._states = [SimpleNamespace(added=None)]  # type: ignore[list-item]

    def _proposal(self, without: Collection[str] = ()) -> str | None:
        assert set(without) == set(self.added)  # what was added is not asked for again
        return self.proposals[len(self.added)]

    def add(self, effect_id: str) -> Any:
        self.added.append(effect_id)
        self._states.append(SimpleNamespace(added=effect_id))  # type: ignore[arg-type]

    def _drop(self) -> None:
        self._states = [self._states[0], self._states[-1]]

    def _moved(self) -> bool:
        return False


def test_what_was_taken_out_does_not_come_back() -> None:
    made = Wavering(["leak", "dark_current", "leak", "dark_current", "leak"])
    made._go_on(3)
    assert made.added == ["leak", "dark_current"]


def test_it_ends_when_nothing_is_proposed() -> None:
    made = Wavering(["leak", "dark_current", None])
    made._go_on(3)
    assert made.added == ["leak", "dark_current"]


@pytest.mark.parametrize(
    ("chosen", "proposal", "explained", "promises", "expected"),
    [
        (True, None, False, True, False),  # all was tried
        (True, "leak", True, False, True),  # it may not be added: there are as many as were asked for
        (False, None, False, False, True),
        (False, None, True, True, True),  # small, but significant
        (False, None, True, False, False),
    ],
)
def test_whether_a_search_that_ended_might_have_gone_on(
    chosen: bool, proposal: str | None, explained: bool, promises: bool, expected: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    made: Any = object.__new__(Diagnosis)
    made._session = SimpleNamespace(problem=None)
    made._shortlist = SimpleNamespace(promises=lambda *_: promises)
    monkeypatch.setattr("bench.diagnosis.diagnosis.is_explained", lambda *_: explained)
    assert made._might_go_on(SimpleNamespace(chosen=chosen, proposal=proposal, fit=None, scores=None)) is expected


def test_a_step_that_is_cut_short_leaves_those_before_it(monkeypatch: pytest.MonkeyPatch) -> None:
    made: Any = object.__new__(Diagnosis)
    made._states = before = [SimpleNamespace(added=None, fit=None), SimpleNamespace(added="leak", fit=None)]
    made._session, made._seed, made._say = SimpleNamespace(problem=None), 1, lambda _: None

    def cut_short(*_: object, **__: object) -> Any:
        raise KeyboardInterrupt

    made._look = cut_short
    for module in ("better_place", "share", "deviance_beside"):
        monkeypatch.setattr(f"bench.diagnosis.diagnosis.{module}", lambda *_: 1.0)
    with pytest.raises(KeyboardInterrupt):
        made._moved()
    assert made._states is before


def fit_at(sigmas: dict[str, float]) -> Any:
    """Return a fit of effects so many standard errors from null."""
    slots = tuple(Slot(Free(name, field, field, "1", "linear", 0.0, 1e3, 3.0)) for name, field in FIELDS.items())
    model = PixelModel() + DarkCurrent(1.0) + Leak(1.0)
    x = np.array([sigmas[name] for name in FIELDS])
    return SimpleNamespace(model=model, slots=slots, x=x, covariance=lambda _: np.eye(len(slots)))


FIELDS = {"dark_current": "mean_fa", "leak": "rate_per_s"}
PROBLEM: Any = SimpleNamespace(measured=SimpleNamespace(points=()))


@pytest.mark.parametrize(("sigmas", "verdict"), [(1.5, True), (2.8, False), (-2.8, False)])
def test_what_chance_makes_is_needless(sigmas: float, verdict: bool) -> None:
    one = fit_at({"dark_current": sigmas, "leak": 9.0})
    assert needless(PROBLEM, one, one, "dark_current") is verdict


@pytest.mark.parametrize(
    ("dark", "leak", "explained", "rises", "expected", "tried"),
    [
        (2.8, 9.0, False, 20.0, "dark_current", ["dark_current"]),  # others made it insignificant
        (2.8, 9.0, False, 50.0, None, ["dark_current"]),  # how large it is is not known: that it is there is
        (2.8, 9.0, True, 20.0, None, ["dark_current"]),
        (4.5, 9.0, False, 0.0, None, []),  # while something is missing nothing is in doubt
        (4.5, 9.0, True, 5.0, "dark_current", ["dark_current"]),
        (4.5, 9.0, True, 20.0, None, ["dark_current"]),  # what is there is missed
        (5.5, 4.5, True, 20.0, None, ["leak", "dark_current"]),  # the weakest first
        (6.5, 9.0, True, 0.0, None, []),
    ],
)
def test_what_does_not_stand_far_out_is_tried_without(
    dark: float, leak: float, explained: bool, rises: float, expected: str | None, tried: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    asked: list[str] = []

    def refit(_: Any, __: Any, name: str, ___: int) -> str:
        asked.append(name)
        return f"without {name}"

    monkeypatch.setattr(taking_out, "without", refit)
    monkeypatch.setattr(taking_out, "deviance", lambda _, __: 600.0)
    monkeypatch.setattr(taking_out, "deviance_per_dof", lambda _, __: 1.0 if explained else 4.0)
    monkeypatch.setattr(taking_out, "nearer", lambda *_: -rises)
    fit = fit_at({"dark_current": dark, "leak": leak})
    sigmas = {"dark_current": dark, "leak": leak}
    found: Any = taking_out.to_take_out(PROBLEM, fit, sigmas, explained, 1)
    assert found == (None if expected is None else (expected, f"without {expected}"))
    assert asked == tried


@pytest.mark.parametrize(("falls", "verdict"), [(75.0, False), (3.0, True), (-20.0, True)])
def test_one_hot_pixel_is_seen_though_the_next_sensor_may_have_none(falls: float, verdict: bool) -> None:
    """How many there are is known to no better than their root: of one, to one; what it does is beyond doubt."""
    n, effect = 700, HotPixels(fraction=1.0 / 256.0, rate_hz=10.0)
    window = SimpleNamespace(roi=SimpleNamespace(pixels=256))
    problem: Any = SimpleNamespace(measured=SimpleNamespace(points=(slice(0, n),)), points=[window])
    slot = Slot(Free(effect.id, "fraction", "fraction", "1", "linear", 0.0, 1e3, 3.0))
    before, after = (
        Fit(
            model=PixelModel() + effect, slots=(slot,), x=np.array([1.0 / 256.0]), start=np.zeros(1),
            value=np.zeros(n), ratio=np.zeros(n), roots=(np.eye(n),), deviation=np.ones(n),
            jacobian=256.0 * np.ones((2, n, 1)) / n**0.5,
            scale=scale, residual=np.full(n, math.sqrt(squares / n)),
        )
        for squares, scale in ((800.0, 1.0), (800.0 - falls, 1.1))
    )  # fmt: skip
    assert needless(problem, before, after, effect.id) is verdict
    none = replace(after, model=PixelModel() + replace(effect, fraction=0.4 / 256.0))
    assert needless(problem, before, none, effect.id)  # what the others have gained by moving is not theirs


@pytest.mark.parametrize(
    ("added", "in_the_end", "expected"),
    [(8.7, 9.5, 3.3), (2.5, 9.5, 2.5), (8.7, 0.0, 0.0)],  # no pixel is left of it: another effect has come for it
)
def test_what_few_pixels_have_is_no_more_than_in_doubt_once_something_else_was_added(
    added: float, in_the_end: float, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What it took away by then it may have taken in the place of another one; of others the last model tells."""
    names = (None, "hot_pixels", "leak", "crosstalk")
    states: Any = [SimpleNamespace(fit=i, added=name) for i, name in enumerate(names)]
    sigmas = {(0, 1): added, (0, 3): in_the_end, (1, 3): 7.0, (2, 3): 5.0}
    monkeypatch.setattr(state, "strength", lambda _, before, one, __: sigmas[before, one])
    assert state.strengths(PROBLEM, states) == {"hot_pixels": expected, "leak": 7.0, "crosstalk": 5.0}
    if in_the_end:
        assert state.strengths(PROBLEM, states[:2])["hot_pixels"] == added
