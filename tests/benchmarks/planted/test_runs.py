"""The run of a case: a run folder as any other, that does not tell the truth."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bench.store import Run, RunError
from benchmarks.planted.cases import Case, Plan, cases
from benchmarks.planted.runs import ROI, make_run, phases_in_run, planned_points
from benchmarks.planted.strange_effects import STRANGE
from benchmarks.planted.truth import _Bench
from sim_backend.pixel.effects.light_flicker import LightFlicker

if TYPE_CHECKING:
    from pathlib import Path

    from sim_backend.pixel.effects import Effect

TINY = Plan((0.08, 1.0, 100.0), (0.5,), (1.0,), long_periods=3, short_periods=3, constant_s=0.5)


def tiny(name: str) -> Case:
    return replace(next(c for c in cases(1) if c.name == name), plan=TINY)


def test_a_run_opens_and_has_the_points(tmp_path: Path) -> None:
    case = tiny("single-000")
    run = Run.open(make_run(case, tmp_path / "run"))
    run.verify()
    points = list(run.points())
    assert [p.index for p in points] == list(range(TINY.points))
    assert [p.nd_od for p in points] == [3.0] * 6 + [0.0] * 3
    assert [p.waveform for p in points[:3]] == ["constant", "square", "square"]
    assert [p.log_contrast for p in points[:3]] == [0.0, 0.5, 1.0]
    assert {p.refractory_s for p in points} == {case.model.refractory_s}
    assert sum(p.n_events for p in points) > 1000  # 256 pixels answer steps of 1.0
    for planned, point in zip(planned_points(case), points, strict=True):
        np.testing.assert_array_equal(point.stimulus_t_s, planned.stimulus_t_s)
        np.testing.assert_array_equal(point.pulse_kind, planned.pulse_kind)
        assert point.roi == ROI


def test_bright_halves_come_first_and_step_up(tmp_path: Path) -> None:
    point = list(Run.open(make_run(tiny("none-000"), tmp_path / "run")).points())[1]
    level = point.stimulus_lux[np.searchsorted(point.stimulus_t_s, point.pulse_start_s[0], side="right") - 1]
    assert point.pulse_kind[0] == 0
    assert level == pytest.approx(point.baseline_lux * np.exp(point.log_contrast))


def test_the_folder_does_not_tell_what_is_planted(tmp_path: Path) -> None:
    folder = make_run(tiny("single-006"), tmp_path / "run")
    text = (folder / "run.yaml").read_text() + (folder / "journal.jsonl").read_text()
    assert "leak" not in text
    assert Run.open(folder).header.everything.keys() <= {"format", "id", "created", "title", "sensor", "roi"}


def test_the_same_case_gives_the_same_events_and_another_seed_others(tmp_path: Path) -> None:
    case = tiny("none-000")
    stamps = []
    for name, one in (("a", case), ("b", case), ("c", replace(case, seed=case.seed + 1))):
        points = Run.open(make_run(one, tmp_path / name)).points()
        stamps.append(np.concatenate([e["t"] for p in points for e in p.events()]))
    np.testing.assert_array_equal(stamps[0], stamps[1])
    assert not np.array_equal(stamps[0], stamps[2])


def test_time_stamps_of_the_reference_engine_do_not_tell_its_step(tmp_path: Path) -> None:
    case = tiny("none-002")
    assert case.reference
    points = Run.open(make_run(case, tmp_path / "run")).points()
    stamps = np.concatenate([e["t"] for p in points for e in p.events()])
    assert np.gcd.reduce(stamps) == 1


def test_a_run_is_never_overwritten(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="exists already"):
        make_run(tiny("none-000"), tmp_path)


@pytest.mark.parametrize("effect", STRANGE, ids=lambda e: e.id)
def test_a_strange_effect_changes_the_events_and_its_null_does_not(effect: type[Effect], tmp_path: Path) -> None:
    one = Plan((100.0,), (1.0,), (), long_periods=2, constant_s=0.2)
    case = replace(tiny("none-000"), plan=one, reference=True, dt_s=5e-5)
    value = effect.parameters()[0]
    gross = effect(**{value.name: min(20.0 * (value.default or 0.0), 0.9 * value.bounds[1])})
    stamps = []
    for name, model in (("without", case.model), ("null", case.model + effect.null()), ("with", case.model + gross)):
        points = Run.open(make_run(replace(case, model=model), tmp_path / name)).points()
        stamps.append(np.concatenate([e for p in points for e in p.events()]))
    np.testing.assert_array_equal(stamps[0], stamps[1])
    assert not np.array_equal(stamps[0], stamps[2])


def test_phases_are_those_of_the_recordings_also_in_what_is_expected_of_the_truth(tmp_path: Path) -> None:
    """A ripple whose phase is given answers as the run does, event for event; sizes are found at those phases."""
    case = next(c for c in cases(1) if "light_flicker" in c.planted and c.kind == "single")
    case = replace(case, plan=TINY)
    ripple = next(e for e in case.model.effects if isinstance(e, LightFlicker))
    assert ripple.phase is None
    points = Run.open(make_run(case, tmp_path / "run")).points()
    phases = phases_in_run(case)
    assert len(set(phases)) == TINY.points
    for point, phase in zip(points, phases, strict=True):
        given = replace(case, model=case.model.changed(replace(ripple, phase=phase)))
        again = list(Run.open(make_run(given, tmp_path / f"given-{point.index}")).points())[point.index]
        recorded, expected = (np.concatenate(list(p.events())) for p in (point, again))
        np.testing.assert_array_equal(recorded, expected)
    given = replace(case, model=case.model.changed(replace(ripple, phase=phases[0])))
    [[first, *_]], [[same, *_]] = (_Bench(one).see(one.model, 0, 1) for one in (case, given))
    np.testing.assert_array_equal(first.products, same.products)


def test_without_a_ripple_there_are_no_phases() -> None:
    assert phases_in_run(tiny("none-000")) == [None] * TINY.points
