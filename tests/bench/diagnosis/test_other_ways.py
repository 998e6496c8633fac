"""Where nothing explains a run, other ways are tried; with made-up fits."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis import diagnosis
from bench.diagnosis.diagnosis import Diagnosis
from bench.diagnosis.searching import detours, refit, shortlist
from bench.diagnosis.searching.shortlist import Shortlist
from bench.diagnosis.searching.state import State
from bench.diagnosis.searching.verdict import group_of, ties_of
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects import (
    ComparatorDelay,
    Crosstalk,
    DarkCurrent,
    HotPixels,
    Leak,
    ResetNoise,
    TrailFilter,
)  # fmt: skip

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence


@pytest.fixture(autouse=True)
def judged_by_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is made up is no fit that could be judged."""
    monkeypatch.setattr(diagnosis, "is_explained", lambda made, _: made.left.get(made.way(made._states), 9.0) < 1.1)
    for module in (diagnosis, detours):
        monkeypatch.setattr(module, "share", lambda _, __, left: 1.0 - left)
    monkeypatch.setattr(detours, "may_be_added", lambda *_: True)
    monkeypatch.setattr(shortlist, "is_far_off", lambda _, __: True)
    monkeypatch.setattr(shortlist, "can_judge", lambda _, __, ___: True)


def found(effect: str, deviance: float) -> Any:
    return SimpleNamespace(effect=effect, deviance=deviance, fit=effect, phases=None, beside=lambda problem: problem)


class MadeUp(Diagnosis):
    """Each effect leaves what the table says, and the way with it goes on with what belongs to it."""

    def __init__(self, left: dict[tuple[str, ...], float], rivals: Sequence[Any]) -> None:
        self.left = left
        self.rivals = rivals
        self.findings = ()
        self._say = lambda _: None
        self._session = SimpleNamespace(problem=self)  # type: ignore[assignment]
        self._states = [self._look("base", None, [])]
        self._states[0].refitted = {f.effect: f for f in rivals}

    def way(self, states: Sequence[Any]) -> tuple[str, ...]:
        return tuple(s.added for s in states[1:])

    def _look(self, fitted: Any, added: str | None, before: Any, in_phase: bool = False) -> Any:
        assert not in_phase
        falls = [1.0 - one.deviance for one in self.rivals if one.effect == added]
        return SimpleNamespace(
            fit=fitted, added=added, fall=falls[0] if falls else 0.9, refitted={}, proposal=None, tied=(),
            problem=self, scores=SimpleNamespace(probes=()),
        )  # fmt: skip

    def _go_on(self, most: int) -> None:
        longer = [way for way in self.left if way[:-1] == self.way(self._states) and way]
        if longer and len(self._states) <= most:
            self._states.append(self._look(longer[0][-1], longer[0][-1], self._states))
            self._go_on(most)

    def _drop(self) -> None:
        """Nothing turns out to be needless."""

    def outcome(self, *, measure_next: bool = True) -> Any:
        assert measure_next
        return self.way(self._states)


def way_of(left: dict[tuple[str, ...], float], most: int = 3) -> tuple[str, ...]:
    way: Any = MadeUp(left, RIVALS).run(most)
    return tuple(way)


RIVALS = [found("light_drift", 0.1), found("leak", 0.3), found("crosstalk", 0.8)]


def test_the_way_that_explains_the_run_is_kept() -> None:
    assert way_of({("light_drift",): 1.7, ("leak", "low_frequency_noise"): 1.0}) == ("leak", "low_frequency_noise")


def test_the_first_way_is_kept_where_none_explains_the_run() -> None:
    assert way_of({("light_drift",): 1.7, ("leak", "low_frequency_noise"): 1.3}) == ("light_drift",)


def test_what_took_much_less_away_is_not_tried() -> None:
    assert way_of({("light_drift",): 1.7, ("crosstalk",): 1.0}) == ("light_drift",)


def test_nothing_else_is_tried_where_the_run_is_explained() -> None:
    assert way_of({("light_drift",): 1.0, ("leak",): 0.9}) == ("light_drift",)


@pytest.mark.parametrize("most", [1, 2])
def test_other_ways_are_no_longer_than_asked(most: int) -> None:
    expected = ("leak", "low_frequency_noise") if most == 2 else ("light_drift",)
    assert way_of({("light_drift",): 1.7, ("leak", "low_frequency_noise"): 1.0}, most) == expected


def test_what_is_needless_on_another_way_is_taken_out() -> None:
    """The first effect stands in for the one that another way adds."""

    class Needless(MadeUp):
        def _drop(self) -> None:
            if self.way(self._states) == ("light_drift", "leak"):
                self._states = [self._states[0], self._states[2]]

    left = {("light_drift",): 2.0, ("light_drift", "crosstalk"): 1.7, ("leak",): 1.0}
    made = Needless(left, [])
    look = made._look

    def with_rival(fitted: Any, added: str | None, before: Any, in_phase: bool = False) -> Any:
        state = look(fitted, added, before, in_phase)
        state.refitted = {"leak": found("leak", 0.1)} if added == "light_drift" else {}
        return state

    made._look = with_rival  # type: ignore[method-assign]
    way: Any = made.run()
    assert way == ("leak",)


def test_what_was_proposed_or_tied_is_no_other_way() -> None:
    made = MadeUp({("light_drift",): 1.7, ("leak",): 1.0}, RIVALS)
    made._states[0].tied = ("leak",)
    way: Any = made.run()
    assert way == ("light_drift",)


def gone_on(phases: Sequence[float]) -> Any:
    """Return a diagnosis in which a ripple got other phases with each step."""
    made = object.__new__(Diagnosis)
    made.findings = ()
    made._states = [SimpleNamespace(problem=phase) for phase in phases]  # type: ignore[misc]
    made._session = SimpleNamespace(problem=phases[-1])  # type: ignore[assignment]
    made._last_step = lambda: made._states[-1]  # type: ignore[method-assign,assignment,return-value]
    return made


def test_what_is_undone_takes_its_phases_along() -> None:
    made = gone_on([0.1, 0.7, 1.9])
    made.undo()
    assert made.problem == 0.7
    made.undo()
    assert made.problem == 0.1


def test_the_first_way_has_its_phases_again_once_others_have_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    made, tried = gone_on([0.1, 0.7, 1.9]), []
    monkeypatch.setattr(diagnosis, "other_ways", lambda *_: [(1, found("leak", 0.3)), (0, found("crosstalk", 0.3))])
    monkeypatch.setattr(diagnosis, "proposing", lambda _, state, __: state)
    monkeypatch.setattr(diagnosis, "is_explained", lambda *_: False)
    made._say = lambda _: None

    def with_another(_: Any) -> Any:
        tried.append((made.problem, made._states[-1].problem))
        made._session.problem = 3.3
        return SimpleNamespace(problem=3.3)

    made._with = with_another
    made._drop = made._go_on = lambda *_: None
    made._try_others(3)
    assert tried == [(0.7, 0.7), (0.1, 0.1)]
    assert made.problem == 1.9
    assert len(made._states) == 3


def test_the_first_way_is_gone_back_to_when_another_is_cut_short(monkeypatch: pytest.MonkeyPatch) -> None:
    made = gone_on([0.1, 0.7, 1.9])
    known = list(made._states)
    monkeypatch.setattr(diagnosis, "other_ways", lambda *_: [(1, found("leak", 0.3))])
    monkeypatch.setattr(diagnosis, "proposing", lambda _, state, __: state)
    made._say = lambda _: None

    def cut_short(*_: object) -> Any:
        made._session.problem = 3.3
        raise KeyboardInterrupt

    monkeypatch.setattr(diagnosis, "is_explained", lambda *_: False)
    made._with = cut_short
    with pytest.raises(KeyboardInterrupt):
        made._try_others(3)
    assert made._states == known
    assert made.problem == 1.9


def test_another_way_that_explains_the_run_is_kept_when_it_is_cut_short() -> None:
    class CutShort(MadeUp):
        _asked: bool

        def _go_on(self, most: int) -> None:
            super()._go_on(most)
            if self.way(self._states) == ("leak", "low_frequency_noise") and not self._asked:
                self._asked = True
                raise KeyboardInterrupt

    made = CutShort({("light_drift",): 1.7, ("leak", "low_frequency_noise"): 1.0}, RIVALS)
    made._asked = False
    with pytest.raises(KeyboardInterrupt):
        made.run()
    assert made.way(made._states) == ("leak", "low_frequency_noise")
    assert made._searching  # so it is not said that all was tried
    made.run()
    assert not made._searching


class Promising(Shortlist):
    """A model far off; each effect takes away the share that the table says, the screen promises what it says."""

    def __init__(self, promised: Sequence[str], shares: dict[str, float]) -> None:
        self.promised, self.shares = promised, shares
        self.asked: list[tuple[list[str], float]] = []
        self.fitted_to_the_end: list[int | None] = []
        self.at_another_size: list[str] = []
        self._asked_all = False
        self.foreseen = True
        self._session = SimpleNamespace(problem=None)  # type: ignore[assignment]

    def state(self) -> Any:
        probes = [SimpleNamespace(effect=SimpleNamespace(id=name)) for name in self.shares]
        scores = SimpleNamespace(probes=probes, drop=np.arange(len(probes), dtype=float))
        return SimpleNamespace(fit=None, scores=scores, refitted={}, proposal=None)

    def _promising(self, *_: Any) -> list[str]:
        return list(self.promised)

    def _is_foreseen(self, _: Any) -> bool:
        return self.foreseen

    def _at_other_sizes(self, _: Any, without: Collection[str]) -> list[str]:
        return [name for name in self.at_another_size if name not in without]

    def _propose(
        self, state: Any, shortlist: Sequence[str], worth: float = 0.15, most: int | None = None,
        leave: float = math.inf,
    ) -> None:  # fmt: skip
        self.asked.append((list(shortlist), worth))
        self.fitted_to_the_end.append(most)
        state.refitted |= dict.fromkeys(shortlist)
        good = [name for name in shortlist if self.shares[name] >= worth]
        state.proposal = max(good, key=lambda name: self.shares[name], default=None)


@pytest.mark.parametrize(("refused", "asked", "proposal"), [
    ((), ["jitter"], "jitter"),
    (("jitter",), ["jitter", "leak"], "leak"),
    (("jitter", "leak", "trail_filter"), ["jitter", "leak", "trail_filter"], None),
])  # fmt: skip
def test_near_the_truth_the_next_one_is_asked_where_the_clearest_is_refused(
    monkeypatch: pytest.MonkeyPatch, refused: tuple[str, ...], asked: list[str], proposal: str | None
) -> None:
    class Near(Promising):
        def _propose(self, state: State, shortlist: Sequence[str], *_: Any, **__: Any) -> None:
            self.asked.append((list(shortlist), 0.0))
            state.proposal = None if shortlist[0] in refused else shortlist[0]

    monkeypatch.setattr(shortlist, "is_far_off", lambda _, __: False)
    names = ["jitter", "leak", "trail_filter", "crosstalk"]
    made = Near(names, dict.fromkeys(names, 0.0))
    state = made.state()
    state.scores.drop = np.array([60.0, 25.0, 20.0, 10.0])
    made.choose(state)
    assert [name for (name,), _ in made.asked] == asked
    assert state.proposal == proposal


def test_near_the_truth_what_promises_about_as_much_as_the_clearest_is_fitted_beside_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The leak does better than the drift, which is a little clearer in the screen."""
    monkeypatch.setattr(shortlist, "is_far_off", lambda _, __: False)
    names = ["light_drift", "crosstalk", "jitter", "high_pass", "leak"]
    made = Promising(names[:4], {"light_drift": 0.3, "crosstalk": 0.1, "jitter": 0.2, "high_pass": 0.9, "leak": 0.8})
    state = made.state()
    state.scores.drop = np.array([70.0, 66.0, 20.0, 69.0, 10.0])
    made.choose(state)
    assert state.proposal == "leak"  # its twin: straight lines may say nothing of it
    assert [names for names, _ in made.asked] == [["light_drift", "crosstalk", "leak"]]


def test_where_nothing_promises_anything_all_are_asked_and_have_to_explain_most() -> None:
    made = Promising(["high_pass"], {"crosstalk": 0.4, "high_pass": 0.1, "reset_noise": 0.9, "hot_pixels": 0.3})
    state = made.state()
    made.choose(state)
    assert state.proposal == "reset_noise"
    assert [names for names, _ in made.asked] == [["high_pass"], ["hot_pixels", "reset_noise", "crosstalk"]]
    assert made.fitted_to_the_end == [None, 3]
    again = made.state()  # once is enough
    made.choose(again)
    assert again.proposal is None
    assert made.asked[2:] == [(["high_pass"], 0.15), ([], 0.75)]


def test_what_promises_something_at_another_size_has_to_explain_most() -> None:
    made = Promising([], {"readout_saturation": 0.8, "crosstalk": 0.1})
    made._asked_all = True
    made.at_another_size = ["crosstalk", "readout_saturation"]
    state = made.state()
    made.choose(state)
    assert made.asked == [(["crosstalk", "readout_saturation"], 0.75)]
    assert state.proposal == "readout_saturation"


@pytest.mark.parametrize("promises", [True, False])
def test_what_moved_to_another_size_is_fitted_again(monkeypatch: pytest.MonkeyPatch, promises: bool) -> None:
    """By hand: the queue promises something at another size, or does not; the leak had the right one."""
    old = [SimpleNamespace(effect=SimpleNamespace(id=name)) for name in ("readout_saturation", "leak")]
    new = [SimpleNamespace(effect=SimpleNamespace(id="readout_saturation")), old[1]]
    monkeypatch.setattr(shortlist, "at_other_sizes", lambda *_: new)
    monkeypatch.setattr(shortlist, "score", lambda _, __, probes, *___, **____: SimpleNamespace(probes=probes))
    made = Promising(["leak", "readout_saturation"] if promises else [], {})
    made._seed = 1
    known: Any = {"leak": found("leak", 3.0), "readout_saturation": found("readout_saturation", 9.0)}
    scores: Any = SimpleNamespace(probes=old)
    nothing: Any = None
    state: Any = State(fit=nothing, scores=scores, added=None, fall=0.0, problem=nothing, refitted=dict(known))
    state.hopeless = frozenset({"readout_saturation", "crosstalk"})
    names = Shortlist._at_other_sizes(made, state, ())
    assert names == (["readout_saturation"] if promises else [])
    assert state.scores.probes == (new if promises else old)
    assert state.refitted == ({"leak": known["leak"]} if promises else known)
    assert state.hopeless == (
        frozenset({"crosstalk"}) if promises else frozenset({"readout_saturation", "crosstalk"})
    )


def test_what_was_taken_out_is_not_asked_again_and_others_are() -> None:
    made = Promising(["leak", "crosstalk"], {"leak": 0.9, "crosstalk": 0.5, "high_pass": 0.9, "trail_filter": 0.9})
    made.at_another_size = ["high_pass", "trail_filter"]
    state = made.state()
    made.choose(state, without={"leak"})
    assert state.proposal == "crosstalk"
    made.shares["crosstalk"] = made.shares["trail_filter"] = 0.0
    again = made.state()
    made.choose(again, without={"leak", "high_pass"})
    assert again.proposal is None
    assert not {"leak", "high_pass"} & {name for names, _ in made.asked for name in names}


@pytest.mark.parametrize("foreseen", [True, False])
def test_where_none_promises_much_of_it_six_are_refitted_at_once(foreseen: bool) -> None:
    """The first three would do, and the fifth does better."""
    names = ["crosstalk", "hot_pixels", "high_pass", "leak", "threshold_mismatch", "reset_noise", "trail_filter"]
    made = Promising(
        names, {"crosstalk": 0.2, "threshold_mismatch": 0.9} | dict.fromkeys(names[1:4] + names[5:], 0.0)
    )
    made.foreseen = foreseen
    state = made.state()
    made.choose(state)
    assert state.proposal == ("crosstalk" if foreseen else "threshold_mismatch")
    assert [asked for asked, _ in made.asked] == [names[:3] if foreseen else names[:6]]


def test_effects_that_want_whole_sensors_are_raced_last(monkeypatch: pytest.MonkeyPatch) -> None:
    entrants: Any = [
        SimpleNamespace(model=PixelModel() + effect) for effect in (Crosstalk(), Leak(), HotPixels(), DarkCurrent())
    ]
    raced: list[Any] = []

    def race(_: Any, those: Sequence[Any], *__: Any) -> list[Any]:
        raced.extend(those)
        return list(those)

    monkeypatch.setattr(refit, "race", race)
    assert refit._raced(None, entrants, None, 1.0) == entrants  # type: ignore[arg-type]
    assert raced == [entrants[k] for k in (1, 3, 2, 0)]


@pytest.mark.parametrize("ambient", ["open", "shrouded"])
def test_what_is_the_same_in_a_run_is_fitted_once(ambient: str) -> None:
    """Behind a shroud there is no stray light, but a dark current: there they are not the same."""
    made = Promising([], {})
    point = SimpleNamespace(attributes={"ambient": ambient})
    made._session = SimpleNamespace(problem=SimpleNamespace(points=[point]))  # type: ignore[assignment]
    names = ["stray_light", "leak", "dark_current", "light_drift"]
    left = ["leak", "dark_current", "light_drift"] if ambient == "open" else names
    assert made._without_the_same(names) == left
    assert made._without_the_same(["stray_light", "leak"]) == ["stray_light", "leak"]


def test_what_explains_some_of_it_alone_is_not_taken_for_what_is_missing() -> None:
    made = Promising([], {"crosstalk": 0.4, "hot_pixels": 0.7})
    state = made.state()
    made.choose(state)
    assert state.proposal is None


def with_effects(added: str | None, group: tuple[str, ...], *has: Any) -> Any:
    return SimpleNamespace(added=added, group=group, fit=SimpleNamespace(model=sum(has, start=PixelModel())))


def test_what_was_tied_and_then_added_is_tied_no_more() -> None:
    delay, trail = ComparatorDelay(delay_s=1e-3), TrailFilter(window_s=0.01)
    first = with_effects(None, ())
    second = with_effects(delay.id, (delay.id, trail.id, "light_rise_time"), delay)
    third = with_effects(trail.id, (trail.id,), delay, trail)
    assert ties_of([first, second], [delay.id]) == {delay.id: (trail.id, "light_rise_time")}
    assert ties_of([first, second, third], [delay.id, trail.id]) == {delay.id: ("light_rise_time",)}
    assert ties_of([first, second], []) == {}


def test_a_person_may_add_another_one_of_a_tie_than_was_proposed() -> None:
    before: Any = SimpleNamespace(proposal="dark_current", tied=("stray_light", "leak"))
    assert group_of(before, "stray_light") == ("dark_current", "stray_light", "leak")
    assert group_of(before, "crosstalk") == ("crosstalk",)  # it is not one of the tie
    before.proposal = None
    assert group_of(before, "leak") == ("leak",)


def test_a_tie_stays_when_what_was_added_before_is_taken_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is between them is fitted without it, too."""
    dark, leak, noise = DarkCurrent(mean_fa=3.0), Leak(rate_per_s=0.1), ResetNoise(rms=0.02)
    made: Any = object.__new__(Diagnosis)
    made._session, made._seed, made._say = SimpleNamespace(problem="last"), 1, lambda _: None
    made._look = lambda fit, added, before: SimpleNamespace(
        fit=fit, added=added, number=len(before), problem=made.problem
    )
    states = [
        with_effects(None, ()),
        with_effects(noise.id, (noise.id,), noise),
        with_effects(dark.id, (dark.id, "stray_light"), noise, dark),
        with_effects(leak.id, (leak.id, "light_drift"), noise, dark, leak),
    ]
    for state in states:
        state.problem = "last"
    made._states = list(states)

    def without(_: Any, fit: Any, name: str, *__: Any) -> Any:
        return SimpleNamespace(model=fit.model.without(name))

    def to_take_out(_: Any, fit: Any, names: Sequence[str], *__: Any) -> Any:
        return (noise.id, without(None, fit, noise.id)) if noise.id in names else None

    monkeypatch.setattr(diagnosis, "is_explained", lambda *_: True)
    monkeypatch.setattr(diagnosis, "to_take_out", to_take_out)
    monkeypatch.setattr(diagnosis, "without", without)
    monkeypatch.setattr(diagnosis, "strengths", lambda _, states: {s.added: 4.0 for s in states[1:]})
    made._drop()
    assert [state.added for state in made._states] == [None, dark.id, leak.id]
    assert [state.fit.model.effects for state in made._states] == [(), (dark,), (dark, leak)]
    assert [state.number for state in made._states[1:]] == [1, 2]
    assert ties_of(made._states, [dark.id, leak.id]) == {dark.id: ("stray_light",), leak.id: ("light_drift",)}


@pytest.mark.parametrize(("best", "rivals"), [
    ("light_drift", ["light_drift", "leak"]),  # whose fit was given up early
    ("hot_pixels", ["hot_pixels"]),
])  # fmt: skip
def test_the_twin_of_the_best_is_looked_at_even_where_its_own_fit_is_refused(
    monkeypatch: pytest.MonkeyPatch, best: str, rivals: list[str]
) -> None:
    asked: list[Any] = []

    def tied_with(_: Any, __: Any, ___: Any, ____: Any, _____: Any, those: Sequence[str], ______: int) -> Any:
        asked.extend(those)
        return ("leak",) if "leak" in those else ()

    class Asking(Promising):
        def __init__(self) -> None:
            super().__init__([], {})
            self._seed = 1
            self._refit = lambda *_: [found(best, 1.0), found("leak", 3.0), found("crosstalk", 9.0)]

        def _without_the_same(self, names: Sequence[str]) -> list[str]:
            return list(names)

        def _with_the_nearest_first(self, those: Sequence[Any]) -> list[Any]:
            return list(those)

    monkeypatch.setattr(shortlist, "may_be_added", lambda _, __, one: one.effect == best)
    monkeypatch.setattr(shortlist, "share", lambda _, __, left: 1.0 - 0.1 * left)
    monkeypatch.setattr(shortlist, "leaves_little", lambda *_: True)
    monkeypatch.setattr(shortlist, "tied_with", tied_with)
    made = Asking()
    state = made.state()
    state.hopeless, state.tied = frozenset({"crosstalk"}), ()
    Shortlist._propose(made, state, [best, "leak", "crosstalk"])
    assert asked == rivals
    assert state.proposal == best
    assert state.tied == tuple(rivals[1:])


@pytest.mark.parametrize(("promised", "rivals"), [(66.0, []), (0.5, ["light_drift", "leak"])])
def test_straight_lines_do_not_tell_what_is_like_a_twin_of_which_they_promised_nothing(
    monkeypatch: pytest.MonkeyPatch, promised: float, rivals: list[str]
) -> None:
    """Beside nothing everything looks alike: a leak was said to be like crosstalk."""
    asked: list[str] = []

    def tied_with(*given: Any) -> tuple[str, ...]:
        asked.extend(given[5])
        return ()

    monkeypatch.setattr(shortlist, "is_far_off", lambda *_: False)
    monkeypatch.setattr(shortlist, "may_be_added", lambda *_: True)
    monkeypatch.setattr(shortlist, "deviance", lambda *_: 9.0)
    monkeypatch.setattr(shortlist, "nearer", lambda *_, **__: -1.0)
    monkeypatch.setattr(shortlist, "leaves_little", lambda *_: True)
    monkeypatch.setattr(shortlist, "freedom", lambda _: 100)
    monkeypatch.setattr(shortlist, "tied_with", tied_with)
    names = ["light_drift", "leak", "crosstalk"]
    made = Promising([], dict.fromkeys(names, 0.0))
    made._seed = 1
    made._session = SimpleNamespace(problem=SimpleNamespace(points=[]))  # type: ignore[assignment]
    made._refit = lambda *_: [found("light_drift", 3.0), found("leak", 1.0)]
    state = made.state()
    state.scores.drop = np.array([70.0, promised, 60.0])
    state.hopeless, state.tied, state.added = frozenset(), (), None
    Shortlist._propose(made, state, ["light_drift", "leak"])
    assert state.proposal == "leak"
    assert asked == rivals
