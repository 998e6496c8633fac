"""A run that is watched: its progress goes on, and its end, its failure and its standstills are told."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from bench.notices import NoticeProgress, Notices, Notifier, RunFacts, Subscription, facts_of, with_notices
from bench.notices.stall import StallWatch
from bench.run import run_protocol
from bench.run.progress import NoProgress, Status
from bench.run.runner import RunResult
from bench.station import load_station
from drivers.errors import DeviceError
from protocols import parse_protocol

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.notices import Kind, Notice

ALL: tuple[Kind, ...] = ("end", "failure", "no_progress", "suspended", "paused")
PROTOCOL = """\
format: evs-bench-protocol/1
title: two points
roi: {x: 632, y: 352, width: 2, height: 2}
measurements:
  - name: dark
    stimulus: {kind: constant, duration_s: 0.5}
    sweep: {illuminance_lux: [10, 100]}
    settle: {light_s: 0.25, filter_s: 1, bias_s: 2}
"""


class Inbox:
    """A way that keeps what it is sent."""

    name = "inbox"

    def __init__(self) -> None:
        self.notices: list[Notice] = []

    def send(self, notice: Notice, timeout_s: float) -> None:
        self.notices.append(notice)


class Recorded(NoProgress):
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.calls: list[Any] = []

    def update(self, status: Status) -> None:
        self.calls.append(status)

    def message(self, text: str) -> None:
        self.calls.append(text)

    def close(self) -> None:
        self.calls.append("closed")


@pytest.fixture(name="inbox")
def inbox_() -> Inbox:
    return Inbox()


@pytest.fixture(name="notifier")
def notifier_(inbox: Inbox) -> Notifier:
    return Notifier(Notices((Subscription(inbox, ALL, 5.0, no_progress_s=100.0),), 2.0))


def status(done: int, total: int = 3, label: str = "on") -> Status:
    return Status(done, total, label, None, None)


def test_a_standstill_is_said_once_for_each_limit_and_again_after_progress() -> None:
    now = [0.0]
    watch = StallWatch((10.0, 30.0), 2.0, lambda: now[0])
    assert watch.overdue() == []
    watch.progressed()
    now[0] = 10.0
    assert watch.overdue() == []
    now[0] = 11.0
    assert watch.overdue() == [(0, 11.0)]
    assert watch.overdue() == []
    now[0] = 31.0
    assert watch.overdue() == [(1, 31.0)]
    watch.progressed()
    now[0] = 42.0
    assert watch.overdue() == [(0, 11.0)]


def test_a_long_point_is_no_standstill_before_its_expected_time_times_the_factor() -> None:
    now = [0.0]
    watch = StallWatch((10.0,), 2.0, lambda: now[0])
    watch.progressed(expected_s=60.0)
    now[0] = 120.0
    assert watch.overdue() == []
    now[0] = 120.5
    assert watch.overdue() == [(0, 120.5)]


def test_nothing_is_expected_of_a_run_that_rests() -> None:
    now = [0.0]
    watch = StallWatch((10.0,), 2.0, lambda: now[0])
    watch.progressed()
    watch.rest()
    now[0] = 1000.0
    assert watch.overdue() == []


def test_progress_is_passed_on_and_only_another_point_counts(notifier: Notifier) -> None:
    now, inner = [0.0], Recorded()
    watch = StallWatch((100.0,), 2.0, lambda: now[0])
    progress = NoticeProgress(inner, notifier, RunFacts("t", "s", None, (1.0, 200.0, 1.0)), watch=watch)
    progress.begin()
    progress.update(status(0))
    now[0] = 90.0
    progress.update(status(0))  # the same point, tried once more
    progress.message("hello")
    now[0] = 101.0
    assert watch.overdue() == [(0, 101.0)]
    progress.update(status(1))  # a point of 200 s
    now[0] = 101.0 + 399.0
    assert watch.overdue() == []
    now[0] = 101.0 + 401.0
    assert len(watch.overdue()) == 1
    progress.close()
    assert inner.calls == [status(0), status(0), "hello", status(1), "closed"]
    notifier.close()


def test_the_rest_of_a_resumed_run_may_take_as_long_as_its_longest_point(notifier: Notifier) -> None:
    now = [0.0]
    watch = StallWatch((100.0,), 2.0, lambda: now[0])
    progress = NoticeProgress(NoProgress(), notifier, RunFacts("t", "s", None, (1.0, 200.0, 1.0)), watch=watch)
    progress.update(status(0, total=2))
    now[0] = 399.0
    assert watch.overdue() == []


def test_the_watching_thread_tells_and_ends_with_the_run(
    inbox: Inbox, notifier: Notifier, until: Callable[[Callable[[], bool]], None]
) -> None:
    now = [0.0]
    watch = StallWatch((100.0,), 2.0, lambda: now[0])
    progress = NoticeProgress(NoProgress(), notifier, RunFacts("t", "s", Path("r")), watch=watch, look_every_s=0.01)
    progress.begin()
    progress.update(status(1))
    now[0] = 7200.0
    until(lambda: len(inbox.notices) == 1)
    notice = inbox.notices[0]
    assert (notice.kind, notice.text, notice.run) == ("no_progress", "nothing new for 2 h 0 min", "r")
    assert (notice.points_done, notice.points, notice.label) == (1, 3, "on")
    progress.close()
    until(lambda: "no progress" not in [thread.name for thread in threading.enumerate()])
    notifier.close()


def test_a_pause_and_a_suspension_are_told(inbox: Inbox, notifier: Notifier) -> None:
    now = [0.0]
    watch = StallWatch((100.0,), 2.0, lambda: now[0])
    progress = NoticeProgress(NoProgress(), notifier, RunFacts("t", "s"), watch=watch)
    progress.begin()
    progress.held("paused", "by the operator")
    now[0] = 1e4
    assert watch.overdue() == []
    progress.going_on()
    now[0] = 2e4
    assert len(watch.overdue()) == 1
    progress.held("suspended", "the disk is full")
    now[0] = 3e4
    assert watch.overdue() == []
    notifier.close(60.0)
    assert [(n.kind, n.text) for n in inbox.notices] == [
        ("paused", "by the operator"),
        ("suspended", "the disk is full"),
    ]


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (DeviceError("camera", "read", "unplugged"), "failure"),
        (KeyboardInterrupt(), "end"),
        (ValueError(), "failure"),
    ],
)
def test_an_error_is_told_and_raised(inbox: Inbox, notifier: Notifier, error: BaseException, told: str) -> None:
    def take(_: object) -> RunResult:
        raise error

    with pytest.raises(type(error)):
        with_notices(take, NoProgress(), notifier, lambda: RunFacts("t", "s"))
    notifier.close(60.0)
    assert [n.kind for n in inbox.notices] == [told]
    assert inbox.notices[0].text


def test_a_run_tells_its_end_and_goes_as_without_notices(inbox: Inbox, notifier: Notifier, tmp_path: Path) -> None:
    loaded, station = parse_protocol(PROTOCOL, "two.yaml"), load_station("simulated")
    facts = facts_of(loaded.protocol, station.name, tmp_path / "run")
    assert facts.expected_s == (3.75, 3.75)
    inner = Recorded()
    result = with_notices(
        lambda progress: run_protocol(loaded, station, tmp_path / "run", progress=progress),
        inner,
        notifier,
        lambda: facts,
    )
    assert (result.done, result.stopped) == (2, False)
    assert [call.done for call in inner.calls[:-1]] == [0, 1, 2]
    notifier.close(60.0)
    (notice,) = inbox.notices
    assert (notice.kind, notice.run, notice.points_done) == ("end", str(tmp_path / "run"), 2)
    assert notice.message == f"EVS bench: two points ended: done: 2 of 2 points, in {tmp_path / 'run'}"


def test_the_outcome_is_left_to_the_caller_where_that_is_asked_for(inbox: Inbox, notifier: Notifier) -> None:
    result = RunResult(Path("r"), "id", 1, 1, stopped=False)
    with_notices(lambda _: result, NoProgress(), notifier, lambda: RunFacts("t", "s"), tell_outcome=False)
    notifier.close(60.0)
    assert inbox.notices == []


def test_without_notices_nothing_is_wrapped() -> None:
    inner = NoProgress()
    result = RunResult(Path("r"), "id", 1, 1, stopped=False)
    seen: list[object] = []

    def take(progress: object) -> RunResult:
        seen.append(progress)
        return result

    assert with_notices(take, inner, None, lambda: RunFacts("t", "s")) is result
    assert seen == [inner]
