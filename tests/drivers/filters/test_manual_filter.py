"""Filters that a person changes."""

from __future__ import annotations

import io
import sys

import pytest

from drivers.errors import DeviceError, WrongState
from drivers.filters.manual import ManualFilter
from protocols.errors import InputError

FILTERS = {"clear": 0.0, "nd30": 3.0}


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_asks_for_each_filter_once() -> None:
    asked: list[str] = []
    wheel = ManualFilter(FILTERS, ask=asked.append, name="ND holder")
    wheel.connect()
    wheel.select("clear")
    wheel.select("nd30")
    wheel.select("nd30")
    assert wheel.selected() == "nd30"
    assert asked == [
        "ND holder: put filter clear (OD 0) into the light path",
        "ND holder: put filter nd30 (OD 3) into the light path",
    ]


def test_a_request_that_fails_leaves_the_filter_unknown() -> None:
    answers = iter([None, RuntimeError("the operator has gone")])

    def ask(request: str) -> None:
        answer = next(answers)
        if answer is not None:
            raise answer

    wheel = ManualFilter(FILTERS, ask=ask)
    wheel.connect()
    with pytest.raises(RuntimeError, match="has gone"):
        wheel.select("nd30")
    with pytest.raises(WrongState, match="no filter was confirmed"):
        wheel.selected()


def test_the_terminal_is_asked_and_enter_confirms(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", Terminal("\n\n"))
    wheel = ManualFilter(FILTERS)
    wheel.connect()
    wheel.select("nd30")
    assert "put filter nd30 (OD 3) into the light path, then press Enter" in capsys.readouterr().out
    assert wheel.selected() == "nd30"


@pytest.mark.parametrize("stdin", [io.StringIO("\n\n"), None])
def test_without_a_terminal_it_says_that_there_is_nobody(
    monkeypatch: pytest.MonkeyPatch, stdin: io.StringIO | None
) -> None:
    monkeypatch.setattr(sys, "stdin", stdin)
    wheel = ManualFilter(FILTERS)
    with pytest.raises(WrongState, match=r"filter: put filter clear .*nobody can be asked.*wheel with a motor"):
        wheel.connect()
    assert not wheel.connected


def test_a_terminal_that_closes_is_no_confirmation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", Terminal("\n"))
    wheel = ManualFilter(FILTERS)
    wheel.connect()
    with pytest.raises(DeviceError, match="closed before it was confirmed"):
        wheel.select("nd30")


@pytest.mark.parametrize("filters", [{}, {"clear": -0.1}, {"clear": float("nan")}])
def test_filters_that_make_no_sense_are_refused(filters: dict[str, float]) -> None:
    with pytest.raises(InputError, match=r"expected (one or more|0 or more)"):
        ManualFilter(filters)
