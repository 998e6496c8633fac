"""Telling the operator what is being done: on a terminal, and elsewhere."""

from __future__ import annotations

import io
import re
import sys
from typing import TYPE_CHECKING

from bench.commands.diagnosing import Teller

if TYPE_CHECKING:
    import pytest


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def test_on_a_terminal_one_line_changes_and_rests_while_somebody_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    with Teller() as tell:
        tell("fitting the model")
        tell.rest()
        tell.rest()
        before = terminal.getvalue()
        terminal.write("ENTER adds leak > ")
        tell("refitting with leak")
    told = terminal.getvalue()
    assert "fitting the model" in before
    assert "\x1b[?25l" in before  # the cursor is hidden while it turns,
    assert before.count("\x1b[?25h") == 1  # and shown while somebody is asked
    assert "refitting with leak" in re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", told)
    assert told.rstrip().count("\x1b[?25h") == 2


def test_elsewhere_each_thing_is_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    with Teller() as tell:
        tell("fitting the model")
        tell("refitting with leak")
    assert capsys.readouterr().err == "fitting the model\nrefitting with leak\n"
