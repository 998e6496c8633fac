"""Contrasts that are added to curves: which, when, why; and that nothing that may happen in a night changes them."""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from night_devices import Telling, with_policy  # type: ignore[import-not-found]
from refining_runs import REFINE, assert_same, contents, decisions, lines, protocol  # type: ignore[import-not-found]

from bench.analysis import analyze
from bench.analysis.grouping import curve_counts
from bench.compute import Workforce
from bench.run import judging, rerun, resume, run_protocol
from bench.run.refining_seen import Answers
from bench.run.stop import StopFlag
from bench.station import load_station, station_from
from bench.store import Run, RunError
from drivers.errors import DataLost
from protocols.points import Roi

if TYPE_CHECKING:
    from collections.abc import Callable

    from protocols import LoadedProtocol

#: Planned are 0 to 4, what may be added is 5 to 8; 4 is the constant point.
PLANNED = 5
WINDOW = Roi(10, 20, 4, 3)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the run that nothing disturbed."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    result = run_protocol(protocol(), load_station("simulated"), folder)
    assert (result.done, result.total, result.stopped) == (9, 9, False)
    return folder


@pytest.fixture
def take(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that takes a protocol into a folder of its own."""

    def into(loaded: LoadedProtocol, **more: Any) -> Path:
        run_protocol(loaded, more.pop("station", None) or load_station("simulated"), tmp_path / "taken", **more)
        return tmp_path / "taken"

    return into


def started(folder: Path) -> list[int]:
    return [line["point"] for line in lines(folder) if line["state"] == "started"]


def test_what_is_added_is_taken_right_after_its_curve_and_numbered_behind_the_plan(whole: Path) -> None:
    assert started(whole) == [0, 1, 2, 3, 5, 6, 7, 8, 4]
    planned = [line["point"] for line in lines(whole) if line["state"] == "planned"]
    assert planned == [0, 1, 2, 3, 4, 5, 6, 7, 8]


def test_the_journal_says_what_was_added_and_why_before_it_is_taken(whole: Path) -> None:
    first, second, end = decisions(whole)
    assert [len(line["points"]) for line in (first, second, end)] == [3, 1, 0]
    assert first["curve"] == second["curve"] == end["curve"] == PLANNED
    assert first["reason"].startswith("on, 100 lux: refined, its largest gap is 0.")
    assert end["reason"].startswith("on, 100 lux: 4 contrasts added, its largest gap is 0.")
    assert end["reason"].endswith(", and no more may be added")
    taken = contents(whole)
    for point in [*first["points"], *second["points"]]:
        assert taken[point["index"]][0] == pytest.approx(point["log_contrast"])
        low, _, high = point["reason"].removeprefix("refined: between ").partition(" and ")
        assert float(low) < point["log_contrast"] < float(high)
    at = [n for n, line in enumerate(lines(whole)) if line["state"] == "plan_changed"]
    first_of = [
        n for n, line in enumerate(lines(whole)) if line.get("point") in (5, 8) and line["state"] == "started"
    ]
    assert at[0] < first_of[0] < at[1] < first_of[1] < at[2]


def widest(folder: Path, points: list[int]) -> tuple[float, float]:
    """Return between which of these points the share of pulses that were answered rises most."""
    (entries,) = Answers(folder, WINDOW).responses(points)
    counts = curve_counts(entries)
    share = counts.answers.sum(axis=1) / counts.trials.sum(axis=1)
    step = int(np.argmax(np.diff(share)))
    return float(counts.log_contrast[step]), float(counts.log_contrast[step + 1])


def test_the_first_contrasts_come_where_the_probability_rises_most(whole: Path) -> None:
    low, high = widest(whole, [0, 1, 2, 3])
    contrasts = [point["log_contrast"] for point in decisions(whole)[0]["points"]]
    assert contrasts[0] == pytest.approx(0.5 * (low + high))


def test_the_run_once_more_is_the_same(whole: Path, tmp_path: Path) -> None:
    assert rerun(whole, tmp_path / "again").done == 9
    assert_same(tmp_path / "again", whole)


def _kills(text: list[str]) -> list[int]:
    """Return after how many lines of a journal a run is killed: around the first decision, and the last."""
    decided = [n for n, line in enumerate(text) if '"plan_changed"' in line]
    return [*(decided[0] + after for after in (0, 1, 2)), *(decided[-1] + after for after in (0, 1))]


@pytest.mark.slow
def test_a_run_that_is_killed_around_a_decision_ends_as_one_that_was_left_alone(whole: Path, tmp_path: Path) -> None:
    text = (whole / "journal.jsonl").read_text().splitlines(keepends=True)
    for kept in _kills(text):
        folder = tmp_path / f"killed{kept}"
        shutil.copytree(whole, folder)
        torn = text[kept][: len(text[kept]) // 2]
        (folder / "journal.jsonl").write_text("".join(text[:kept]) + torn)
        keep = {json.loads(line)["file"] for line in text[:kept] if '"done"' in line}
        if '"done"' in text[kept]:  # killed before the line of a file that is whole
            keep.add(json.loads(text[kept])["file"])
        for file in (folder / "points").iterdir():
            if f"points/{file.name}" not in keep:
                file.unlink()
        result = resume(folder)
        assert (result.done, result.total, result.stopped) == (9, 9, False), kept
        assert_same(folder, whole)


def test_a_run_that_is_stopped_goes_on_with_what_was_decided(whole: Path, tmp_path: Path) -> None:
    stop = StopFlag()
    told = Telling(5, stop.request)
    first = run_protocol(protocol(), load_station("simulated"), tmp_path / "run", progress=told, stop=stop)
    assert first.stopped
    assert first.total == 8  # one of the four was not decided upon yet
    told = Telling()
    result = resume(tmp_path / "run", progress=told)
    assert (result.done, result.total) == (9, 9)
    assert_same(tmp_path / "run", whole)
    assert resume(tmp_path / "run").total == 9
    assert_same(tmp_path / "run", whole)


@pytest.mark.slow
def test_several_workers_take_the_same_points(tmp_path: Path) -> None:
    """Two curves at a time; which is ready first must not matter."""
    two = protocol(REFINE, ("illuminance_lux: [100]\n      contrast", "illuminance_lux: [30, 100]\n      contrast"))
    run_protocol(two, load_station("simulated"), tmp_path / "one")
    result = run_protocol(two, load_station("simulated"), tmp_path / "several", workforce=Workforce(2))
    assert (result.done, result.total) == (17, 17)
    mine, theirs = contents(tmp_path / "several"), contents(tmp_path / "one")
    assert {i: (c, s, len(e)) for i, (c, s, e) in mine.items()} == {
        i: (c, s, len(e)) for i, (c, s, e) in theirs.items()
    }
    by_curve = [sorted(decisions(tmp_path / name), key=lambda line: line["curve"]) for name in ("several", "one")]
    assert by_curve[0] == by_curve[1]


def test_progress_tells_the_plan_so_far_and_the_most_there_can_be(take: Callable[..., Path]) -> None:
    told = Telling()
    take(protocol(), progress=told)
    assert [(s.total, s.at_most) for s in told.seen] == [
        (5, 9), (5, 9), (5, 9), (5, 9), (8, 9), (8, 9), (8, 9), (9, None), (9, None), (9, None),
    ]  # fmt: skip
    assert told.text.startswith("point 1 of 5 (at most 9): on, 100 lux")
    assert "on, 100 lux: 4 contrasts added" in told.text


def test_a_curve_that_is_known_well_enough_gets_no_more(take: Callable[..., Path]) -> None:
    folder = take(protocol("refine: {until: {gap: 0.999}, at_most: 50}"))
    assert started(folder) == [0, 1, 2, 3, 4]
    (end,) = decisions(folder)
    assert end["points"] == []
    assert end["reason"].startswith("on, 100 lux: 0 contrasts added, its largest gap is ")


@pytest.mark.parametrize(("key", "limit"), [("half_se", 0.008), ("theta_se", 0.04)])
def test_the_standard_error_that_was_asked_for_is_what_analyze_says(
    key: str, limit: float, take: Callable[..., Path]
) -> None:
    folder = take(protocol(f"refine: {{until: {{{key}: {limit}}}, at_most: 40}}", ("pulses: 4", "pulses: 12")))
    (curve,) = analyze(Run.open(folder)).curves
    found = curve.half if key == "half_se" else curve.theta
    assert found is not None
    error = 0.5 * (found.high - found.low) / 1.6448536269514722
    added = len(started(folder)) - PLANNED
    assert decisions(folder)[-1]["reason"] == f"on, 100 lux: {added} contrasts added, its {key} is {error:.2g}"
    assert error <= limit
    assert 0 < added < 40


def test_a_flat_curve_is_left_as_it_is(take: Callable[..., Path]) -> None:
    folder = take(protocol(REFINE, ("linspace: {start: 0.1, stop: 1.5, num: 4}", "values: [0.01, 0.02]")))
    assert decisions(folder)[0]["reason"] == "on, 100 lux: 0 contrasts added, its answers do not rise with contrast"


def test_a_light_with_coarse_steps_is_asked_for_no_finer_ones(take: Callable[..., Path]) -> None:
    plan: dict[str, Any] = load_station("simulated").resolved
    plan["roles"]["light"]["args"]["level_step"] = 300.0
    coarse = station_from(plan, "coarse.yaml")
    folder = take(protocol("refine: {until: {gap: 0.001}, at_most: 60}"), station=coarse)
    assert decisions(folder)[-1]["reason"].endswith(", and the light has no finer steps")
    taken = sorted(contrast for index, (contrast, *_) in contents(folder).items() if index != 4)
    assert len(set(taken)) == len(taken) < 60


def test_both_responses_of_a_square_wave_count(take: Callable[..., Path]) -> None:
    text = (
        ("{kind: reset_test, polarity: \"on\", gap_s: 0.03, reset_s: 0.03, test_s: 0.03,\n"
         "               reset_contrast: {scale: log, value: 0.8}}"),
        "{kind: square, frequency_hz: 10}",
    )  # fmt: skip
    folder = take(protocol(REFINE, text))
    assert started(folder) == [0, 1, 2, 3, 5, 6, 7, 8, 4]


def _failing(monkeypatch: pytest.MonkeyPatch, *at: int) -> None:
    """Let the light fail when it plays for one of these times."""
    light = type(load_station("simulated").light)
    play, count = light._play, [0]

    def failing(self: Any, waveform: Any) -> Any:
        count[0] += 1
        if count[0] in at:
            raise DataLost("light source", "play", "the line went dead")
        return play(self, waveform)

    monkeypatch.setattr(light, "_play", failing)


@pytest.mark.parametrize("at", [1, 4, 5])
def test_a_point_that_is_skipped_holds_nothing_up(
    at: int, take: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    _failing(monkeypatch, at)
    folder = take(with_policy(protocol(), "policy: {on_failure: {then: skip, wait_s: 0}}"))
    assert lines(folder)[-1]["state"] == "run_finished"
    assert sorted(started(folder)) == list(range(9))
    assert len(contents(folder)) == 8
    contrasts = [point["log_contrast"] for line in decisions(folder) for point in line["points"]]
    assert len(set(contrasts)) == 4  # that of the skipped one is not tried again


def test_skipped_points_that_are_tried_again_change_no_decision(
    take: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        _failing(patch, 2)
        folder = take(with_policy(protocol(), "policy: {on_failure: {then: skip, wait_s: 0}}"))
    before = decisions(folder)
    assert resume(folder, retry_skipped=True).done == 9
    assert decisions(folder) == before


def test_a_red_point_is_not_used_for_deciding(take: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    """Without point 1 it lies between two others, and nothing tells in which half of that step."""
    record = judging.Judge.record

    def judged(self: Any, recorder: Any, planned: Any, file: Any) -> Any:
        found, _ = record(self, recorder, planned, file)
        return found, judging.Judged("red" if planned.point.index == 1 else "green", ())

    monkeypatch.setattr(judging.Judge, "record", judged)
    folder = take(protocol())
    contrast = [contents(folder)[i][0] for i in range(4)]
    (used,) = Answers(folder, WINDOW).responses(range(PLANNED))
    assert curve_counts(used).log_contrast.tolist() == pytest.approx([contrast[0], contrast[2], contrast[3]])
    assert widest(folder, [0, 1, 2, 3]) == pytest.approx((contrast[0], contrast[2]))
    added = [point["log_contrast"] for point in decisions(folder)[0]["points"]]
    assert added[:2] == pytest.approx([0.5 * (contrast[0] + contrast[1]), 0.5 * (contrast[1] + contrast[2])])


def test_a_point_that_is_bad_and_taken_again_is_used_when_it_is_good(
    whole: Path, take: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    record, bad = judging.Judge.record, {1, 6}

    def judged(self: Any, recorder: Any, planned: Any, file: Any) -> Any:
        found, worth = record(self, recorder, planned, file)
        index = planned.point.index
        light = "red" if index in bad else worth.light
        bad.discard(index)
        return found, judging.Judged(light, ())

    monkeypatch.setattr(judging.Judge, "record", judged)
    folder = take(with_policy(protocol(), "policy: {on_bad_point: {retries: 1, budget: 5}}"))
    assert_same(folder, whole)
    assert not bad


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"curve": 5', '"curve": 4', r"the protocol in run.yaml has no curve 4 to add points to"),
        ('"curve": 5', '"curve": "x"', r"the protocol in run.yaml has no curve 'x' to add points to"),
        ('"index": 5', '"index": 99', r"on, 100 lux cannot have a point 99 by the protocol in run.yaml"),
        ('"index": 6', '"index": 5', r"on, 100 lux cannot have a point 5 by the protocol in run.yaml"),
        ('"points": [{', '"points": [7, {', r"on, 100 lux cannot have a point None by the protocol"),
        ('"log_contrast": 0', '"log_contrast": -0', r"point 5: -0.\d+ is no log contrast"),
        ('"log_contrast": 0', '"log_contrast": "a", "x": 0', r"point 5: 'a' is no log contrast"),
    ],
)
def test_a_decision_that_the_protocol_does_not_allow_is_told_in_one_line(
    old: str, new: str, message: str, whole: Path, tmp_path: Path
) -> None:
    shutil.copytree(whole, tmp_path / "run")
    file = tmp_path / "run/journal.jsonl"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    before = file.read_text()
    with pytest.raises(RunError, match=rf"journal\.jsonl: {message}") as caught:
        resume(tmp_path / "run")
    assert len(str(caught.value).splitlines()) == 1
    assert file.read_text() == before


def test_the_window_of_a_resumed_run_is_that_of_its_run_yaml(tmp_path: Path) -> None:
    """Where the points that are left have another window than the run, their files must say so."""
    windows = (
        "contrast:\n",
        "roi: [{x: 10, y: 20, width: 4, height: 3}, {x: 30, y: 40, width: 3, height: 2}]\n      contrast:\n",
    )
    two = protocol(REFINE, windows)
    run_protocol(two, load_station("simulated"), tmp_path / "whole")
    stop = StopFlag()
    told = Telling(9, stop.request)
    assert run_protocol(two, load_station("simulated"), tmp_path / "run", progress=told, stop=stop).stopped
    resume(tmp_path / "run")
    assert_same(tmp_path / "run", tmp_path / "whole")
    rois = [{p.index: p.roi for p in Run.open(tmp_path / name).points()} for name in ("run", "whole")]
    assert rois[0] == rois[1]
    assert len(set(rois[0].values())) == 2
