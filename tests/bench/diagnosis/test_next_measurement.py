"""What is tied is told apart by a protocol of ours, where one is known or found to help."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.searching import next_measurement as module
from bench.diagnosis.searching.next_measurement import next_measurement, protocol_for, with_rivals
from protocols import load_protocol
from protocols.points import Roi
from sim_backend.pixel.effects.registry import effects

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

NOTHING: Any = None


@pytest.fixture
def apart(monkeypatch: pytest.MonkeyPatch) -> Callable[[dict[str, float], Sequence[str]], list[str]]:
    """Let protocols tell an effect from others by some standard errors, the rest by none. Return what is tried."""

    def with_separations(known: dict[str, float], others: Sequence[str]) -> list[str]:
        tried: list[str] = []

        def separation(_: Any, __: Any, rivals: Sequence[str], protocol: str, ____: int) -> float:
            assert list(rivals) == [f"with {other}" for other in others]
            tried.append(protocol)
            return known.get(protocol, 0.0)

        monkeypatch.setattr(module, "stand_in", lambda _, __, other, ___: f"with {other.id}")
        monkeypatch.setattr(module, "_separation", separation)
        return tried

    return with_separations


@pytest.mark.parametrize(
    ("group", "protocol"),
    [
        (("dark_current", "stray_light"), "pulse_width"),
        (("stray_light", "dark_current", "photoreceptor_bandwidth"), "pulse_width"),
        (("dark_current", "photoreceptor_bandwidth"), "pulse_width"),
        (("leak", "hot_pixels"), "background_activity"),
    ],
)
def test_what_is_known_to_help_is_proposed_if_it_does(
    apart: Callable[..., list[str]], group: tuple[str, ...], protocol: str
) -> None:
    assert set(group) <= set(effects())
    known = protocol_for(group)
    assert known is not None
    assert known[0] == protocol
    tried = apart({protocol: 17.04, "quick_look": 30.0}, group[1:])
    found = next_measurement(NOTHING, NOTHING, {group[0]: group[1:]}, 1)
    assert found is not None
    assert tried == [protocol]
    assert (found["protocol"], found["separates"], found["separation"]) == (protocol, list(group), 17.0)
    assert found["minutes"] == pytest.approx(load_protocol(protocol).protocol.estimate().duration_s / 60.0, abs=0.05)


@pytest.mark.parametrize(
    ("few", "many", "sides", "expected"),
    [(30.0, 32.0, [8], 30.0), (9.0, 12.0, [8, 16], 12.0), (0.0, 1.0, [8, 16], 1.0)],
)
def test_more_pixels_are_simulated_where_a_few_do_not_tell(
    monkeypatch: pytest.MonkeyPatch, few: float, many: float, sides: list[int], expected: float
) -> None:
    """Of each there are as many as in the run."""
    like = SimpleNamespace(roi=Roi(0, 0, 32, 32))
    asked: list[int] = []

    def planned_points(planned: Any, _: Any, __: Any, side: int) -> list[Any]:
        asked.append(side)
        return [SimpleNamespace(roi=Roi(0, 0, side, side))] * len(planned)

    def apart_at(_: Any, __: Any, ___: Any, points: Sequence[Any], of_all: float, ____: int) -> float:
        assert of_all == pytest.approx(1024 / points[0].roi.pixels)
        return few if points[0].roi.width == 8 else many

    monkeypatch.setattr(module, "planned_points", planned_points)
    monkeypatch.setattr(module, "apart_at", apart_at)
    problem: Any = SimpleNamespace(points=[like])
    fit: Any = SimpleNamespace(model=None)
    assert module._separation(problem, fit, [NOTHING], "quick_look", 1) == expected
    assert asked == sides


def test_where_nothing_is_known_the_first_that_is_enough_is_proposed(apart: Callable[..., list[str]]) -> None:
    assert protocol_for(("crosstalk", "dark_current")) is None
    tried = apart({"quick_look": 3.0, "pulse_width": 8.0, "on_family": 40.0}, ["dark_current"])
    found = next_measurement(NOTHING, NOTHING, {"crosstalk": ("dark_current",)}, 1)
    assert found is not None
    assert found["protocol"] == "pulse_width"
    assert "pulse_width" in found["title"]
    assert tried == ["quick_look", "background_activity", "pulse_width"]


def test_another_protocol_takes_the_place_of_one_that_does_not_help(apart: Callable[..., list[str]]) -> None:
    apart({"pulse_width": 1.0, "background_activity": 4.0}, ["photoreceptor_bandwidth"])
    found = next_measurement(NOTHING, NOTHING, {"dark_current": ("photoreceptor_bandwidth",)}, 1)
    assert found is not None
    assert (found["protocol"], found["separation"]) == ("background_activity", 4.0)


def test_nothing_is_proposed_where_nothing_helps(apart: Callable[..., list[str]]) -> None:
    assert next_measurement(NOTHING, NOTHING, {}, 1) is None
    apart({"quick_look": 1.5}, ["photoreceptor_bandwidth"])
    assert next_measurement(NOTHING, NOTHING, {"dark_current": ("photoreceptor_bandwidth",)}, 1) is None


def _searched(*steps: tuple[str | None, dict[str, float]]) -> list[Any]:
    """Return states of a search: what was added, and by how much each effect is expected to let the error fall."""
    model: list[str | None] = []
    found = []
    for added, drops in steps:
        model = [*model, added]
        scores = SimpleNamespace(
            probes=[SimpleNamespace(effect=SimpleNamespace(id=name)) for name in drops], drop=list(drops.values())
        )
        effect = {name: name for name in model}.get
        found.append(
            SimpleNamespace(added=added, scores=scores, fit=SimpleNamespace(model=SimpleNamespace(effect=effect)))
        )
    return found


def _points(*widths_s: float, waveform: str = "reset_test") -> list[Any]:
    start = np.zeros(3)
    return [SimpleNamespace(waveform=waveform, pulse_start_s=start, pulse_stop_s=start + w) for w in widths_s]


DARK = _searched(
    (
        None,
        {
            "dark_current": 1345.0,
            "stray_light": 1521.0,
            "photoreceptor_bandwidth": 1249.0,
            "comparator_delay": 600.0,  # less than half as good
            "crosstalk": 1300.0,  # no protocol is known for it
        },
    ),
    ("dark_current", {"leak": 3.0}),
)
LEAK = _searched((None, {"leak": 900.0, "hot_pixels": 800.0}), ("leak", {"hot_pixels": 3.0}))


def test_what_was_nearly_as_good_is_told_apart_as_well_where_it_is_known_how() -> None:
    found = with_rivals(_points(0.02, 0.02), DARK, ["dark_current"], {"dark_current": ("stray_light",)})
    assert found == {"dark_current": ("stray_light", "photoreceptor_bandwidth")}
    assert with_rivals(_points(0.02), LEAK, ["leak"], {}) == {"leak": ("hot_pixels",)}


def test_of_each_protocol_that_helps_it_is_known_whether_a_run_has_it() -> None:
    assert {protocol for _, protocol, _ in module._APART} == set(module._HAS)


def test_what_a_run_shows_already_is_not_asked_for_again() -> None:
    tied = {"dark_current": ("stray_light",)}
    assert with_rivals(_points(0.02, 0.1), DARK, ["dark_current"], tied) == tied
    assert with_rivals([*_points(0.02), *_points(0.0, waveform="constant")], LEAK, ["leak"], {}) == {}


@pytest.mark.parametrize(
    ("states", "missing"),
    [
        # What was added as well is in the model, and what may be chance is no rival.
        (_searched((None, {"leak": 900.0, "hot_pixels": 800.0}), ("leak", {"hot_pixels": 700.0}), ("hot_pixels", {})),
         ["leak", "hot_pixels"]),
        (_searched((None, {"leak": 30.0, "hot_pixels": 19.0}), ("leak", {})), ["leak"]),
        # What turned out to be needless is not named; a person may have added what was not looked at.
        (LEAK, []),
        (_searched((None, {"hot_pixels": 800.0}), ("leak", {})), ["leak"]),
        ([], []),
    ],
)  # fmt: skip
def test_what_is_in_the_model_or_may_be_chance_is_no_rival(states: list[Any], missing: list[str]) -> None:
    assert with_rivals(_points(0.02), states, missing, {}) == {}
