"""Who wins a race of effects, and who is left behind: the losses are written down by hand."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from bench.diagnosis.expected.catalogue import switches
from bench.diagnosis.expected.parameters import Free, base_parameters
from bench.diagnosis.expected.problem import Known, Problem, Slot
from bench.diagnosis.fitting.approach import Approach
from bench.diagnosis.fitting.cloud import Cloud, Place
from bench.diagnosis.fitting.probe import Probe
from bench.diagnosis.searching import race as module
from bench.diagnosis.searching.race import near_by, race
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects import DarkCurrent, HotPixels, Leak, LowFrequencyNoise, StrayLight

STATISTICS = 100


@dataclass(frozen=True)
class Measured:
    value: Any


@dataclass(frozen=True)
class FakeProblem:
    measured: Measured = Measured(np.zeros(STATISTICS))
    given: Any = field(default_factory=dict)


def entrant(effect: Any, number: str, size: float) -> Approach:
    """Return a model of one base number, whose true value is 1, and of an effect."""
    slots = (
        Slot(Free("base", "base", "base", "1", "linear", -10.0, 10.0, 1.0, effect=False)),
        Slot(Free(effect.id, number, number, "1", "linear", 0.0, 1e3, size)),
    )
    at = np.array([0.0, size])
    return Approach(PixelModel() + effect, slots, at, at, np.inf, 1, np.zeros((2, 2)), 0.2, Cloud())


@pytest.fixture
def walks(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Any]]:
    """Losses by hand: ways end at the minimum of their effect; what is looked at costs by its distance."""
    least = {"dark_current": 90.0, "stray_light": 95.0, "leak": 9000.0}
    best_size = {"dark_current": 3.0, "stray_light": 0.05, "leak": 0.1}
    done: dict[str, list[Any]] = {"along": [], "further": [], "looks": []}

    def effect_of(way: Approach) -> str:
        return way.model.effects[-1].id

    def loss(way: Approach, at: Any) -> float:
        name = effect_of(way)
        return float(least[name] + 1e4 * (at[0] - 1.0) ** 2 + 1e4 * (at[1] / best_size[name] - 1.0) ** 2)

    def along(_: Any, way: Approach, *__: Any, **___: Any) -> Approach:
        done["along"].append(effect_of(way))
        at = np.array([1.0, best_size[effect_of(way)]])
        return replace(way, at=at, loss=loss(way, at))

    def scanned(_: Any, way: Approach, places: Any) -> Approach:
        done["looks"] += [effect_of(way)] * len(places)
        at = min(places, key=lambda place: loss(way, place))
        return replace(way, at=at, loss=loss(way, at))

    def further(_: Any, way: Approach, __: int) -> Approach:
        done["further"].append(effect_of(way))
        return way

    monkeypatch.setattr(module, "_along", along)
    monkeypatch.setattr(module, "scanned", scanned)
    monkeypatch.setattr(module, "further", further)
    return done


DARK = entrant(DarkCurrent(3.0), "mean_fa", 2.0)
STRAY = entrant(StrayLight(0.05), "illuminance_lux", 0.04)
LEAK = entrant(Leak(0.1), "rate_per_s", 0.3)


def test_once_one_explains_the_run_the_others_have_to_do_as_well(walks: dict[str, list[Any]]) -> None:
    found = race(FakeProblem(), [DARK, LEAK, STRAY])  # type: ignore[arg-type]
    assert [one.way and one.way.loss for one in found] == [90.0, None, 95.0]
    assert [one.hopeless for one in found] == [False, True, False]
    # The leak was only looked at; stray light goes on from the base numbers of the dark current.
    assert walks["along"] == ["dark_current", "stray_light"]
    assert walks["looks"].count("leak") == 14
    assert walks["further"] == ["dark_current", "stray_light"]


def test_where_many_are_asked_only_the_best_go_all_the_way(walks: dict[str, list[Any]]) -> None:
    found = race(FakeProblem(), [LEAK, STRAY, DARK], most=1)  # type: ignore[arg-type]
    assert [one.way and one.way.loss for one in found] == [None, None, 90.0]
    assert walks["further"] == ["dark_current"]
    assert walks["looks"].count("leak") == 0  # it is out before it is tried with the numbers of the best


def test_those_before_the_best_are_tried_with_its_numbers(walks: dict[str, list[Any]]) -> None:
    found = race(FakeProblem(), [LEAK, DARK])  # type: ignore[arg-type]
    assert [one.way and one.way.loss for one in found] == [None, 90.0]
    assert walks["along"] == ["leak", "dark_current"]  # nothing was known that explains the run
    assert walks["looks"] == ["leak"] * 14 + ["dark_current"] * 7  # at the end its own size is doubted
    assert walks["further"] == ["dark_current"]


def test_a_way_that_ended_at_another_size_goes_on_from_where_it_is_better(
    walks: dict[str, list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    def into_a_valley(_: Any, way: Approach, __: int) -> Approach:
        return replace(way, at=np.array([1.0, 0.3]), loss=8000.0)

    monkeypatch.setattr(module, "further", into_a_valley)
    found = race(FakeProblem(), [DARK])  # type: ignore[arg-type]
    assert [one.way and one.way.loss for one in found] == [90.0]
    assert walks["along"] == ["dark_current", "dark_current"]


def test_a_shape_that_trades_places_with_its_size_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """A way ends anywhere along a valley of equal diffusion, rms^2 / tau, that falls towards a tau of 0.6 s."""
    diffusion, tau_s = 0.01, 0.6

    def loss(at: Any) -> float:
        tau = math.exp(at[1])
        return float(100.0 + 50.0 * math.log2(tau / tau_s) ** 2 + 1e6 * (at[0] / tau / diffusion - 1.0) ** 2)

    def scanned(_: Any, way: Approach, places: Any) -> Approach:
        at = min(places, key=loss)
        return replace(way, at=at, loss=loss(at))

    monkeypatch.setattr(module, "scanned", scanned)
    monkeypatch.setattr(module, "_along", lambda _, way, *__, **___: way)
    slots = (
        Slot(Free("low_frequency_noise", "rms", "rms", "ln", "square", 0.0, 1.0, 0.05)),
        Slot(Free("low_frequency_noise", "tau_s", "tau_s", "s", "log", 1e-3, 1e3, 1.0)),
    )
    at = np.array([diffusion * 8.0 * tau_s, math.log(8.0 * tau_s)])
    model = PixelModel() + LowFrequencyNoise(0.05, 1.0)
    way = Approach(model, slots, at, at, loss(at), 1, np.zeros((2, 2)), 0.2, Cloud())
    found = module._resized(FakeProblem(), way)  # type: ignore[arg-type]
    assert math.exp(found.at[1]) == pytest.approx(tau_s)
    assert found.at[0] == pytest.approx(diffusion * tau_s)
    # A shape that is known is left alone: this one is far too small for its size to be right elsewhere.
    known = FakeProblem(given={"low_frequency_noise": {"tau_s": 8.0 * tau_s}})
    assert math.exp(module._resized(known, way).at[1]) == pytest.approx(8.0 * tau_s)  # type: ignore[arg-type]


def test_what_is_known_beforehand_starts_where_it_is_known_to_be() -> None:
    """A fit that was far off has moved a number that the settings tell, to stand in for what is missing."""
    frees = base_parameters(refractory_known=True)
    slots = tuple(Slot(f) for f in frees)
    start, moved = np.zeros(len(slots)), np.linspace(0.1, 0.5, len(slots))
    here: Any = SimpleNamespace(model=PixelModel(), slots=slots, x=moved, start=start)
    probe = Probe(Leak, switches(Leak), (0.05,), np.zeros((2, 1, 1)))
    scores: Any = SimpleNamespace(probes=[probe], size=[np.array([0.02])], base=[np.full(len(slots), 0.2)])
    problem: Any = Told({})
    at = module.entrant(problem, here, scores, 0, seed=1, far_off=True).at
    known = [f.owner == "refractory_period" for f in frees]
    assert at[:-1] == pytest.approx(np.where(known, start, moved + 0.2))
    near = module.entrant(problem, here, scores, 0, seed=1, far_off=False).at
    assert near[:-1] == pytest.approx(moved)


class Told:
    """What the events themselves tell of a run."""

    given: ClassVar = {HotPixels.id: {"rate_hz": 3.0}}
    told, start_of = Problem.told, Problem.start_of

    def __init__(self, known: dict[tuple[str, str], Known]) -> None:
        self.known = known


def test_hot_pixels_that_were_counted_start_with_their_number_whatever_the_screen_expects() -> None:
    """The screen knows of those that were simulated alone."""
    here: Any = SimpleNamespace(model=PixelModel(), slots=(), x=np.zeros(0), start=np.zeros(0))
    probe = Probe(HotPixels, switches(HotPixels), (0.06,), np.zeros((2, 1, 1)))
    scores: Any = SimpleNamespace(probes=[probe], size=[np.array([0.1])], base=[np.zeros(0)])
    counted = {(HotPixels.id, "fraction"): Known(0.03, 0.001), (HotPixels.id, "rate_hz"): Known(1.0, 0.1)}
    problem: Any = Told(counted)
    one = module.entrant(problem, here, scores, 0, seed=1, far_off=True)
    assert (one.at == one.start).all()
    assert one.at.tolist() == [0.03, 1.0]
    assert [s.free.prior_sd for s in one.slots] == pytest.approx([0.0003, 0.03])
    problem = Told({})
    one = module.entrant(problem, here, scores, 0, seed=1, far_off=True)
    assert one.at == pytest.approx([0.1, np.log(3.0)])
    assert all(np.isinf(s.free.prior_sd) for s in one.slots)


@pytest.mark.parametrize(("fell", "ends_at"), [(50.0, 0.3), (70.0, 0.03)])
def test_a_small_effect_stays_where_it_is_expected_unless_elsewhere_is_clearly_better(
    monkeypatch: pytest.MonkeyPatch, fell: float, ends_at: float
) -> None:
    """Little effort tells the loss to some 30."""

    def along(_: Any, way: Approach, *__: Any, **___: Any) -> Approach:
        seen: Any = None
        expected, best = (
            Place(np.array([0.0, size]), seen, loss) for size, loss in ((0.3, 400.0), (0.03, 400.0 - fell))
        )
        return replace(way, at=best.at, loss=best.loss, cloud=Cloud([expected, best]))

    monkeypatch.setattr(module, "_along", along)
    way = near_by(FakeProblem(), LEAK)  # type: ignore[arg-type]
    assert way.at[1] == ends_at
