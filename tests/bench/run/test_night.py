"""A night without an operator: points fail, hang or are bad, devices go away, conditions are not right."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from night_devices import Telling, journal, light, states, with_policy  # type: ignore[import-not-found]

from bench.run import StopFlag, run_protocol
from bench.run.reconnecting import OtherDevices
from bench.run.verdict import Verdict
from bench.station import DevicesFailed, Station
from bench.store import Run
from drivers.errors import DataLost
from drivers.events.types import EVENT_DTYPE

if TYPE_CHECKING:
    from protocols import LoadedProtocol

StationMaker = Callable[..., Station]
RETRY = "policy: {on_failure: {retries: 2, then: skip}, reconnect: {attempts: 2, wait_s: 1}}"


def _is_dark(station: Station) -> bool:
    return bool(station.light._world.level == 0.0)  # type: ignore[attr-defined]


def _events(folder: Path) -> list[Any]:
    return [np.concatenate([np.empty(0, EVENT_DTYPE), *point.events()]) for point in Run.open(folder).points()]


def test_a_point_that_fails_is_tried_again_and_the_run_is_as_if_it_had_not(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    told = Telling()
    station = make_station(light=light(fails_at=frozenset({2, 3})))
    result = run_protocol(with_policy(protocol, RETRY), station, tmp_path / "run", progress=told)
    assert (result.done, result.skipped, result.stopped) == (4, 0, False)
    assert states(tmp_path / "run")[3:9] == [
        ("started", 1, 1), ("failed", 1, 1), ("started", 1, 2), ("failed", 1, 2), ("started", 1, 3), ("done", 1, 3),
    ]  # fmt: skip
    assert "the line went dead" in journal(tmp_path / "run")[8]["reason"]
    assert station.light.lives == 3  # type: ignore[attr-defined]
    assert "point 1 failed and is tried again: light source: play" in told.text
    run_protocol(protocol, make_station(), tmp_path / "undisturbed")
    for one, other in zip(_events(tmp_path / "run"), _events(tmp_path / "undisturbed"), strict=True):
        np.testing.assert_array_equal(one, other)
    assert _is_dark(station)


def test_a_point_that_keeps_failing_is_skipped_and_accounted_for(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    told = Telling()
    station = make_station(light=light(fails_at=frozenset({2, 3, 4})))
    result = run_protocol(with_policy(protocol, RETRY), station, tmp_path / "run", progress=told)
    assert (result.done, result.skipped, result.total, result.stopped) == (3, 1, 4, False)
    lines = [line for line in journal(tmp_path / "run") if line.get("point") == 1]
    assert [line["state"] for line in lines][-2:] == ["failed", "skipped"]
    assert "the line went dead" in lines[-1]["reason"]
    assert states(tmp_path / "run")[-1][0] == "run_finished"
    (remark,) = Run.open(tmp_path / "run").remarks()
    assert remark.startswith("1 of 4 planned points were skipped (light source: play a waveform: the line went dead")
    assert "3 of 4 points done, 1 skipped" in told.text
    assert told.seen[-1].skipped == 1


def test_without_a_policy_the_first_failure_ends_the_run(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    told = Telling()
    station = make_station(light=light(fails_at=frozenset({2})))
    with pytest.raises(DataLost):
        run_protocol(protocol, station, tmp_path / "run", progress=told)
    assert station.light.lives == 1  # type: ignore[attr-defined]
    assert journal(tmp_path / "run")[-1]["end"] == "failed"
    assert f"go on with: evs-bench resume {tmp_path / 'run'}" in told.text


def test_a_device_that_comes_back_late_is_waited_for(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    station = make_station(light=light(fails_at=frozenset({2}), gone_for=1))
    assert run_protocol(with_policy(protocol, RETRY), station, tmp_path / "run").done == 4
    assert station.light.lives == 3  # type: ignore[attr-defined]


def test_a_device_that_stays_away_ends_the_run(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    station = make_station(light=light(fails_at=frozenset({2}), gone_for=99))
    with pytest.raises(DevicesFailed, match="no such port"):
        run_protocol(with_policy(protocol, RETRY), station, tmp_path / "run")
    assert journal(tmp_path / "run")[-1]["state"] == "run_aborted"
    assert len(Run.open(tmp_path / "run")) == 1


def test_another_device_in_its_place_is_refused(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    station = make_station(light=light(fails_at=frozenset({2}), other_after_failure=True))
    with pytest.raises(OtherDevices, match=r"light\.serial was '.*', and is 'another one' now; put back"):
        run_protocol(with_policy(protocol, RETRY), station, tmp_path / "run")
    assert _is_dark(station)


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="nothing can cut a call of the system short here")
def test_a_step_that_hangs_is_cut_short(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a virtual clock a step has a multiple of its limit in real time, a smaller one here: nothing is compiled."""
    run_protocol(protocol, make_station(), tmp_path / "warm")
    monkeypatch.setattr("bench.run.deadline._VIRTUAL", 3.0)
    policy = "policy: {on_failure: {retries: 1, then: abort}, deadline: {factor: 2, at_least_s: 0.2}}"
    station = make_station(light=light(hangs_at=frozenset({2})))
    slow = with_policy(protocol, policy)
    assert run_protocol(slow, station, tmp_path / "run").done == 4
    failed = next(line for line in journal(tmp_path / "run") if line["state"] == "failed")
    assert (failed["point"], failed["attempt"]) == (1, 1)
    assert failed["reason"].startswith("station box: take point 1: took longer than")


@pytest.fixture
def bad_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let point 1 be judged bad the first two times."""
    times = {1: 2}

    def judge(record: Any, *_: Any) -> Verdict:
        left = times.get(record.index, 0)
        times[record.index] = left - 1
        return Verdict("red", ("no trigger came",)) if left > 0 else Verdict("green")

    monkeypatch.setattr("bench.run.verdict.judge", judge)


@pytest.mark.usefixtures("bad_twice")
def test_a_bad_point_is_taken_again_and_the_bad_ones_are_kept_as_evidence(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    told = Telling()
    retries = with_policy(protocol, "policy: {on_bad_point: {retries: 3}}")
    assert run_protocol(retries, make_station(), tmp_path / "run", progress=told).done == 4
    lines = [line for line in journal(tmp_path / "run") if line.get("file") and line["point"] == 1]
    assert [(line["state"], line["attempt"], line["file"], line["verdict"]) for line in lines] == [
        ("rejected", 1, "points/000001.h5", "red"),
        ("rejected", 2, "points/000001.r1.h5", "red"),
        ("done", 3, "points/000001.r2.h5", "green"),
    ]
    assert lines[0]["reasons"] == ["no trigger came"]
    assert "point 1 is bad and taken again: no trigger came" in told.text
    run = Run.open(tmp_path / "run")
    run.verify()
    assert [file.path.name for file in run.files][1] == "000001.r2.h5"
    assert (tmp_path / "run/points/000001.h5").exists()


@pytest.mark.usefixtures("bad_twice")
@pytest.mark.parametrize(
    ("policy", "ends"),
    [
        ("{retries: 1}", [("rejected", "000001.h5"), ("done", "000001.r1.h5")]),
        ("{retries: 9, budget: 1, then: skip}", [("rejected", "000001.h5"), ("rejected", "000001.r1.h5")]),
        ("{}", [("done", "000001.h5")]),
    ],
)
def test_when_no_trial_is_left_a_bad_point_is_kept_or_skipped(
    policy: str, ends: list[tuple[str, str]], make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    run_policy = with_policy(protocol, f"policy: {{on_bad_point: {policy}}}")
    result = run_protocol(run_policy, make_station(), tmp_path / "run")
    lines = [line for line in journal(tmp_path / "run") if line.get("file") and line["point"] == 1]
    assert [(line["state"], Path(line["file"]).name) for line in lines] == ends
    assert lines[-1]["verdict"] == "red"
    assert result.skipped == ("skip" in policy)
    assert result.done + result.skipped == 4
    Run.open(tmp_path / "run").verify()


class _TooWarm:
    """A condition that is not right for some looks."""

    name = "temperature_c"

    def __init__(self, looks: int) -> None:
        self.looks = looks
        self.dark: list[bool] = []

    def why(self) -> str | None:
        self.looks -= 1
        return "31.2 C is above 30 C" if 0 <= self.looks < 3 else None


def _suspended_by(condition: _TooWarm, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bench.run.holding.suspenders_of", lambda *_: (condition,))


def test_a_run_waits_until_the_conditions_are_right(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _suspended_by(_TooWarm(5), monkeypatch)
    station, told = make_station(), Telling()
    begin_s = station.clock.now()
    waiting = with_policy(protocol, "suspend: {check_every_s: 100, give_up_after_s: 1000}")
    assert run_protocol(waiting, station, tmp_path / "run", progress=told).done == 4
    assert station.clock.now() - begin_s > 300.0
    lines = [line for line in journal(tmp_path / "run") if line["state"] in ("suspended", "resumed")]
    assert [(line["state"], line["reason"]) for line in lines] == [
        ("suspended", "31.2 C is above 30 C"), ("resumed", "was suspended"),
    ]  # fmt: skip
    assert "suspended: 31.2 C is above 30 C; it goes on by itself" in told.text


def test_a_run_that_waited_for_too_long_is_stopped(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _suspended_by(_TooWarm(3), monkeypatch)
    waiting = with_policy(protocol, "suspend: {check_every_s: 100, give_up_after_s: 150, then: stop}")
    station = make_station()
    result = run_protocol(waiting, station, tmp_path / "run", stop=StopFlag())
    assert (result.done, result.stopped) == (0, True)
    assert journal(tmp_path / "run")[-1]["reason"] == "suspended for 200 s, and given up: 31.2 C is above 30 C"
    assert _is_dark(station)


def test_disk_room_is_looked_at_by_itself(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    waiting = with_policy(
        protocol, "suspend: {disk_free_mib: 1.0e+9, check_every_s: 1, give_up_after_s: 2, then: stop}"
    )
    assert run_protocol(waiting, make_station(), tmp_path / "run").stopped
    assert "MiB" in journal(tmp_path / "run")[-1]["reason"]
