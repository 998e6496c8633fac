"""A queue is worked through; what fails, stops or is killed is gone on with."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.notices import Notices, Notifier, Subscription
from bench.queueing import QueueResult, load_queue, resume_queue, run_queue, taking
from bench.queueing.journal import read_past
from bench.queueing.running import asked_for
from bench.queueing.summary import summarize
from bench.run import run_protocol
from bench.store import Run
from drivers.errors import DeviceError
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bench.notices import Notice
    from bench.run import RunResult, StopFlag


class Inbox:
    name = "inbox"

    def __init__(self) -> None:
        self.notices: list[Notice] = []

    def send(self, notice: Notice, timeout_s: float) -> None:
        self.notices.append(notice)


def states(result: QueueResult) -> list[str]:
    return [outcome.state for outcome in result.outcomes]


def journal(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "queue.jsonl").read_text().splitlines()]


def resumed(folder: Path, crew: Any, **more: Any) -> QueueResult:
    return resume_queue(*asked_for(folder), folder, crew.of(**more))


def events(folder: Path) -> list[Any]:
    run = Run.open(folder)
    return [np.concatenate([np.empty(0), *(chunk["t"] for chunk in point.events())]) for point in run.points()]


@pytest.fixture(name="failing")
def failing_runs(monkeypatch: pytest.MonkeyPatch) -> dict[str, BaseException]:
    """Return a mapping: the error that a run whose folder has this name ends with, once."""
    errors: dict[str, BaseException] = {}
    true = run_protocol

    def run_or_fail(loaded: Any, station: Any, out: Path, **more: Any) -> RunResult:
        if out.name in errors:
            raise errors.pop(out.name)
        return true(loaded, station, out, **more)

    monkeypatch.setattr(taking, "run_protocol", run_or_fail)
    return errors


def test_each_run_has_a_folder_and_the_references_a_drift(
    folder: Path, write_queue: Callable[..., Path], crew: Any
) -> None:
    more = "reference: {protocol: dark.yaml, every: 2}\n"
    path = write_queue("protocol: bright.yaml, repeat: 2, warm_up: {minutes: 5}", more=more)
    result = run_queue(load_queue(path), folder / "out", crew.of())
    assert states(result) == ["done"] * 4
    assert (result.stopped_by_operator, result.left) == (False, 0)
    assert [len(Run.open(outcome.folder)) for outcome in result.outcomes] == [1, 2, 2, 1]
    assert "warmed up for 5.0 min, the sensor is at 25.0 degC" in crew.told
    assert (folder / "out/queue.yaml").read_text() == path.read_text()
    assert [line["state"] for line in journal(folder / "out")] == [
        "queue_started", "run_started", "warmed_up", "run_done", *["run_started", "run_done"] * 3, "queue_finished",
    ]  # fmt: skip
    summary = summarize(result)
    assert summary.problems == ()
    assert [(d.quantity, d.runs) for d in summary.drifts] == [
        ("ON background at 1 lux", 2), ("OFF background at 1 lux", 2),
    ]  # fmt: skip
    assert json.loads((folder / "out/summary.json").read_text())["left"] == 0
    assert (folder / "out/drift.csv").read_text().startswith("run,created,quantity,unit,value,low,high\n1,")


def test_a_folder_that_exists_is_refused(folder: Path, write_queue: Callable[..., Path], crew: Any) -> None:
    queue = load_queue(write_queue("protocol: dark.yaml"))
    (folder / "out").mkdir()
    with pytest.raises(InputError, match=r"exists already, .*queue --resume"):
        run_queue(queue, folder / "out", crew.of())
    assert list((folder / "out").iterdir()) == []


@pytest.mark.parametrize(
    ("on_failure", "found"), [("next", ["done", "failed", "done"]), ("stop", ["done", "failed", "not begun"])]
)
def test_a_failure_is_kept_told_and_gone_on_with(
    folder: Path,
    write_queue: Callable[..., Path],
    crew: Any,
    failing: dict[str, BaseException],
    on_failure: str,
    found: list[str],
) -> None:
    failing["002-dark"] = DeviceError("camera", "start", "unplugged")
    path = write_queue("protocol: dark.yaml", f"protocol: dark.yaml, seed: 7, on_failure: {on_failure}",
                       "protocol: dark.yaml, seed: 8")  # fmt: skip
    inbox = Inbox()
    notifier = Notifier(Notices((Subscription(inbox, ("end", "failure"), 5.0),), 2.0))
    result = run_queue(load_queue(path), folder / "out", crew.of(notifier=notifier))
    notifier.close(60.0)
    assert states(result) == found
    assert not result.stopped_by_operator
    failed = result.outcomes[1]
    assert (failed.cause, "unplugged" in str(failed.reason)) == ("device", True)
    assert [(n.kind, n.title) for n in inbox.notices] == [
        ("failure", "run 2 of 3 (dark) of queue night"), ("end", "queue night"),
    ]  # fmt: skip
    assert "unplugged" in (folder / "out/evs-bench.log").read_text()
    again = resumed(folder / "out", crew)
    assert states(again) == ["done", "done", "done"]
    assert [line["run"] for line in journal(folder / "out") if line["state"] == "run_started"].count(1) == 1


def test_a_bug_in_one_run_does_not_end_the_night(
    folder: Path, write_queue: Callable[..., Path], crew: Any, failing: dict[str, BaseException]
) -> None:
    failing["001-dark"] = ZeroDivisionError("division by zero")
    result = run_queue(load_queue(write_queue("protocol: dark.yaml, repeat: 2")), folder / "out", crew.of())
    assert states(result) == ["failed", "done"]
    assert (result.outcomes[0].cause, result.outcomes[0].reason) == ("bug", "ZeroDivisionError: division by zero")
    assert "Traceback" in (folder / "out/evs-bench.log").read_text()


def test_a_disk_that_takes_no_line_ends_the_queue_and_is_told(
    folder: Path, write_queue: Callable[..., Path], crew: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from bench.queueing.journal import QueueJournal

    true = QueueJournal.note

    def note(self: QueueJournal, state: str, **more: Any) -> None:
        if state != "queue_started":
            raise InputError("queue.jsonl: cannot be written: No space left on device")
        true(self, state, **more)

    monkeypatch.setattr(QueueJournal, "note", note)
    inbox = Inbox()
    notifier = Notifier(Notices((Subscription(inbox, ("end", "failure"), 5.0),), 2.0))
    with pytest.raises(InputError, match="No space left"):
        run_queue(load_queue(write_queue("protocol: dark.yaml")), folder / "out", crew.of(notifier=notifier))
    notifier.close(60.0)
    assert [(n.kind, "No space left" in n.text) for n in inbox.notices] == [("failure", True)]


def test_a_light_that_cannot_be_made_dark_ends_the_night(
    folder: Path, write_queue: Callable[..., Path], crew: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unsafe(loaded: Any, station: Any, out: Path, **_: Any) -> RunResult:
        station.light.unsafe = DeviceError("lamp", "make dark", "no answer")
        raise station.light.unsafe

    monkeypatch.setattr(taking, "run_protocol", unsafe)
    result = run_queue(load_queue(write_queue("protocol: dark.yaml, repeat: 2")), folder / "out", crew.of())
    assert states(result) == ["failed", "not begun"]
    assert any("safe state" in line for line in crew.told)


def test_a_run_that_is_given_up_is_no_wish_of_the_operator(
    folder: Path, write_queue: Callable[..., Path], crew: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    true = run_protocol

    def give_up(loaded: Any, station: Any, out: Path, *, stop: StopFlag, **more: Any) -> RunResult:
        if out.name == "001-dark":
            stop.request()
        return true(loaded, station, out, stop=stop, **more)

    monkeypatch.setattr(taking, "run_protocol", give_up)
    result = run_queue(load_queue(write_queue("protocol: dark.yaml, repeat: 2")), folder / "out", crew.of())
    assert states(result) == ["suspended", "done"]
    assert states(resumed(folder / "out", crew)) == ["done", "done"]


def test_ctrl_c_in_a_run_stops_the_queue_after_the_point(
    folder: Path, write_queue: Callable[..., Path], crew: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    true = run_protocol

    def ctrl_c(loaded: Any, station: Any, out: Path, **more: Any) -> RunResult:
        level = station.light.set_level

        def set_level_and_press(value: float) -> None:
            level(value)
            if out.name == "002-bright" and value and not more["stop"].requested:
                os.kill(os.getpid(), signal.SIGINT)

        monkeypatch.setattr(station.light, "set_level", set_level_and_press)
        return true(loaded, station, out, **more)

    monkeypatch.setattr(taking, "run_protocol", ctrl_c)
    result = run_queue(load_queue(write_queue("protocol: bright.yaml, repeat: 3")), folder / "out", crew.of())
    assert states(result) == ["done", "stopped", "not begun"]
    assert (result.stopped_by_operator, result.outcomes[1].points_done) == (True, 1)
    assert journal(folder / "out")[-1]["state"] == "queue_stopped"
    assert states(resumed(folder / "out", crew)) == ["done"] * 3
    assert len(Run.open(folder / "out/002-bright")) == 2


def test_stopping_at_once_says_how_to_go_on(
    folder: Path, write_queue: Callable[..., Path], crew: Any, failing: dict[str, BaseException]
) -> None:
    failing["002-dark"] = KeyboardInterrupt("stopped at once")
    with pytest.raises(KeyboardInterrupt, match=r"go on with: evs-bench queue --resume .*out"):
        run_queue(load_queue(write_queue("protocol: dark.yaml, repeat: 2")), folder / "out", crew.of())
    assert [line["state"] for line in journal(folder / "out")][-2:] == ["run_stopped", "queue_stopped"]
    assert states(resumed(folder / "out", crew)) == ["done"] * 2


def test_the_rest_of_a_queue_is_warmed_up_for_again(
    folder: Path, write_queue: Callable[..., Path], crew: Any, failing: dict[str, BaseException]
) -> None:
    failing["002-dark"] = DeviceError("camera", "start", "unplugged")
    path = write_queue("protocol: dark.yaml, repeat: 2, warm_up: {minutes: 1}")
    run_queue(load_queue(path), folder / "out", crew.of())
    resumed(folder / "out", crew)
    assert [line["run"] for line in journal(folder / "out") if line["state"] == "warmed_up"] == [1, 2]


def test_what_was_asked_for_is_what_is_resumed(
    folder: Path, write_queue: Callable[..., Path], crew: Any, failing: dict[str, BaseException]
) -> None:
    failing["001-dark"] = KeyboardInterrupt()
    path = write_queue("protocol: dark.yaml")
    with pytest.raises(KeyboardInterrupt):
        run_queue(load_queue(path), folder / "out", crew.of())
    (folder / "dark.yaml").write_text("no longer a protocol")
    write_queue("protocol: dark.yaml, repeat: 3")
    with pytest.raises(InputError) as caught:
        asked_for(folder / "out", path)
    assert str(caught.value).splitlines()[0] == (
        f"{path}:4:1: is '- {{protocol: dark.yaml, repeat: 3}}', but was '- {{protocol: dark.yaml}}' "
        "when the queue was begun"
    )
    assert states(resumed(folder / "out", crew)) == ["done"]  # with the protocol of then


def test_an_edited_copy_or_station_is_refused(
    folder: Path, write_queue: Callable[..., Path], crew: Any, failing: dict[str, BaseException]
) -> None:
    from importlib.resources import files

    text = files("bench").joinpath("stations", "simulated.yaml").read_text(encoding="utf-8")
    (folder / "lab.yaml").write_text(text)
    failing["001-dark"] = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        run_queue(load_queue(write_queue("protocol: dark.yaml, station: lab.yaml")), folder / "out", crew.of())
    (folder / "lab.yaml").write_text(text.replace("noise_rms: 0.05", "noise_rms: 0.06"))
    with pytest.raises(InputError, match=r"lab.yaml:\d+:1: is 'noise_rms: 0.06', but was 'noise_rms: 0.05'"):
        asked_for(folder / "out")
    (folder / "lab.yaml").write_text(text)
    copy = folder / "out/queue.yaml"
    copy.write_text(copy.read_text() + "  - {protocol: bright.yaml}\n")
    with pytest.raises(InputError, match=r"queue.yaml:5:1: is '- {protocol: bright.yaml}', but was not there"):
        asked_for(folder / "out")


def test_a_torn_line_is_ignored_and_one_process_at_a_time_works(
    folder: Path, write_queue: Callable[..., Path], crew: Any
) -> None:
    from bench.queueing.journal import QueueJournal

    out = folder / "out"
    run_queue(load_queue(write_queue("protocol: dark.yaml")), out, crew.of())
    with (out / "queue.jsonl").open("a") as file:
        file.write('{"t": "2026", "state": "run_fai')
    assert read_past(out).done == {1}
    with QueueJournal(out), pytest.raises(InputError, match="another process"):
        QueueJournal(out)
    assert journal(out)[-1]["state"] == "queue_finished"
    (out / "queue.jsonl").write_text('{"state": "run_done"}\n')
    with pytest.raises(InputError, match=r"queue.jsonl:1:1: expected"):
        read_past(out)
    with pytest.raises(InputError, match="this is no queue"):
        read_past(folder)


def test_a_run_that_was_killed_before_its_first_line_is_begun_anew(
    folder: Path, write_queue: Callable[..., Path], crew: Any, failing: dict[str, BaseException]
) -> None:
    out = folder / "out"
    failing["001-dark"] = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        run_queue(load_queue(write_queue("protocol: dark.yaml")), out, crew.of())
    (out / "001-dark/points").mkdir(parents=True)
    (out / "001-dark/run.yaml.part").write_text("form")
    assert states(resumed(out, crew)) == ["done"]


def test_a_folder_with_something_of_somebody_else_is_left_alone(
    folder: Path, write_queue: Callable[..., Path], crew: Any, failing: dict[str, BaseException]
) -> None:
    out = folder / "out"
    failing["001-dark"] = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        run_queue(load_queue(write_queue("protocol: dark.yaml")), out, crew.of())
    (out / "001-dark").mkdir()
    (out / "001-dark/notes.txt").write_text("mine")
    result = resumed(out, crew)
    assert (states(result), result.outcomes[0].cause) == (["failed"], "input")
    assert (out / "001-dark/notes.txt").read_text() == "mine"


POINTS = 12
CHILD = """\
import sys
from bench.commands.queue import command
command.main(sys.argv[1:], standalone_mode=False)
"""


def test_a_queue_that_is_killed_goes_on_where_it_was(
    folder: Path, write_queue: Callable[..., Path], crew: Any
) -> None:
    path = folder / "bright.yaml"
    levels = ", ".join(str(10 + 2 * n) for n in range(POINTS))
    path.write_text(path.read_text().replace("10, 100", levels).replace("duration_s: 2", "duration_s: 1"))
    queue_file = write_queue("protocol: dark.yaml", "protocol: bright.yaml", "protocol: dark.yaml, seed: 3")
    whole = run_queue(load_queue(queue_file), folder / "whole", crew.of())
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p or "." for p in sys.path)}
    out = folder / "killed"
    with subprocess.Popen(
        [sys.executable, "-c", CHILD, str(queue_file), "--out", str(out)], env=environment, stderr=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
    ) as child:  # fmt: skip
        deadline_s = time.monotonic() + 60.0
        while len(list((out / "002-bright/points").glob("*.h5"))) < 3:
            assert child.poll() is None, "it was over before it was killed"
            assert time.monotonic() < deadline_s
            time.sleep(0.002)
        child.kill()
    assert len(list((out / "002-bright/points").glob("*.h5"))) < POINTS
    assert read_past(out).done == {1}
    result = resumed(out, crew)
    assert states(result) == ["done"] * 3
    for one, other in zip(whole.outcomes, result.outcomes, strict=True):
        for a, b in zip(events(one.folder), events(other.folder), strict=True):
            assert np.array_equal(a, b)
    assert sum(map(len, events(out / "002-bright"))) > 3
