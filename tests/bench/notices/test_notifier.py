"""Notices on their way: tried again, bounded in time, and never in the way of a run."""

from __future__ import annotations

import logging
import threading
import time
from typing import TYPE_CHECKING, Any

import pytest

from bench.notices import Notices, Notifier, Subscription, notifying
from bench.notices.way import NotSent, tls_context
from bench.notices.webhook import Webhook

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bench.notices import Kind, Notice

Until = "Callable[[Callable[[], bool]], None]"


class FakeWay:
    """A way that does what it is told to do, one thing for each attempt; then it sends."""

    name = "fake"

    def __init__(self, *failures: BaseException) -> None:
        self.failures = list(failures)
        self.sent: list[str] = []
        self.attempts = 0
        self.held = threading.Event()
        self.held.set()

    def send(self, notice: Notice, timeout_s: float) -> None:
        self.attempts += 1
        self.held.wait(60.0)
        if self.failures:
            raise self.failures.pop(0)
        self.sent.append(notice.kind)


def notifier(way: Any, *on: Kind, pauses_s: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Notifier:
    return Notifier(Notices((Subscription(way, on or ("failure",), 5.0),), 2.0), pauses_s)


def test_a_notice_goes_to_those_who_asked_for_its_kind(notice: Notice) -> None:
    ways = FakeWay(), FakeWay()
    both = Notifier(
        Notices((Subscription(ways[0], ("end", "failure"), 5.0), Subscription(ways[1], ("end",), 5.0)), 2.0)
    )
    both.tell(notice)
    assert both.close(60.0) == ()
    assert [way.sent for way in ways] == [["failure"], []]


def test_what_may_go_through_later_is_tried_again(notice: Notice) -> None:
    way = FakeWay(NotSent("busy", again=True), NotSent("busy", again=True))
    one = notifier(way)
    one.tell(notice)
    assert one.close(60.0) == ()
    assert (way.attempts, way.sent) == (3, ["failure"])


def test_in_the_end_it_is_one_line_in_the_log(notice: Notice, caplog: pytest.LogCaptureFixture) -> None:
    way = FakeWay(*[NotSent("busy", again=True)] * 4)
    one = notifier(way)
    with caplog.at_level(logging.INFO, "evs_bench.notices"):
        one.tell(notice)
        assert one.close(60.0) == ("fake: notice of failure not sent: busy",)
    assert [record.getMessage() for record in caplog.records] == ["fake: notice of failure not sent: busy"]
    assert way.attempts == 4


@pytest.mark.parametrize("error", [NotSent("no such address", again=False), RuntimeError("a bug")])
def test_what_cannot_go_through_is_not_tried_again_and_the_next_is(notice: Notice, error: Exception) -> None:
    way = FakeWay(error)
    one = notifier(way)
    one.tell(notice)
    one.tell(notice)
    assert len(one.close(60.0)) == 1
    assert (way.attempts, way.sent) == (2, ["failure"])


def test_a_way_that_hangs_holds_up_neither_the_run_nor_the_other_ways_nor_the_end(
    notice: Notice, until: Callable[[Callable[[], bool]], None]
) -> None:
    stuck, good = FakeWay(), FakeWay()
    stuck.held.clear()
    both = Notifier(Notices((Subscription(stuck, ("failure",), 5.0), Subscription(good, ("failure",), 5.0)), 2.0))
    begin_s = time.monotonic()
    for _ in range(3):
        both.tell(notice)
    assert time.monotonic() - begin_s < 5.0
    until(lambda: len(good.sent) == 3)
    assert both.close(0.1) == ("fake: not all notices could leave in the last 0.1 s",)
    assert time.monotonic() - begin_s < 30.0
    stuck.held.set()


def test_at_the_end_nobody_waits_for_the_next_attempt(notice: Notice) -> None:
    way = FakeWay(NotSent("busy", again=True))
    one = notifier(way, pauses_s=(3600.0,))
    one.tell(notice)
    assert one.close(60.0) == ()
    assert way.sent == ["failure"]


@pytest.mark.parametrize("pauses_s", [(0.0,), (3600.0,)], ids=["before the close", "in the close"])
def test_what_goes_wrong_at_the_end_is_in_the_log_of_the_run(
    notice: Notice, tmp_path: Path, pauses_s: tuple[float, ...]
) -> None:
    from dataclasses import replace

    (tmp_path / "evs-bench.log").write_text("the run\n")
    one = notifier(FakeWay(NotSent("busy", again=True), NotSent("no such address", again=False)), pauses_s=pauses_s)
    one.tell(replace(notice, run=str(tmp_path)))
    one.close(60.0)
    first, second = (tmp_path / "evs-bench.log").read_text().splitlines()
    assert first == "the run"
    assert second.endswith("fake: notice of failure not sent: no such address")


def test_more_than_can_wait_is_dropped_and_said(notice: Notice) -> None:
    way = FakeWay()
    way.held.clear()
    one = notifier(way)
    for _ in range(60):
        one.tell(notice)
    assert "others wait already" in one.problems[0]
    way.held.set()
    one.close(60.0)
    assert 50 <= len(way.sent) <= 51


def test_a_real_server_that_fails_twice_gets_the_notice(web: Any, notice: Notice) -> None:
    web.answers = [503, 500]
    one = notifier(Webhook(web.url, None, tls_context(None)))
    one.tell(notice)
    assert one.close(60.0) == ()
    assert len(web.received) == 3


def test_what_went_wrong_is_told_at_the_end_of_the_command(web: Any, notice: Notice, tmp_path: Path) -> None:
    web.answers = [404]
    (tmp_path / "n.yaml").write_text(
        f"format: evs-bench-notices/1\nnotices:\n  - {{kind: webhook, url: '{web.url}/s3cr3t', on: [failure]}}\n"
    )
    told: list[str] = []
    with notifying(tmp_path / "n.yaml", told.append) as one:
        assert one is not None
        one.tell(notice)
    assert told == [f"webhook {web.url}: notice of failure not sent: the server answered 404"]
    with notifying(None, told.append) as nobody:
        assert nobody is None
