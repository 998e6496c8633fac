"""How an RS-7 is asked and how it answers.

Every command is answered at once with an empty line: the unit has it. Then comes `Ok` when the command is carried
out (a level: when the light has settled), or one line, or the rows of a list up to an empty line, or `?nn - text`.
The empty line at the beginning and that at the end of a list look alike, so they are told apart by counting: the
first line is the acknowledgement and nothing else. Alarms (`?A4 - text`) may come between any two lines.

Source: Gamma Scientific, SpectralLED RS-7 User Manual, rev. A/X1 (2018), chapter 4.
"""

from __future__ import annotations

import math
import re
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from drivers.errors import DeviceTimeout, UnexpectedAnswer
from drivers.light.rs7_errors import Complaint, Treatment, complaint_in, complaint_raised

if TYPE_CHECKING:
    from collections.abc import Callable

    from drivers.transport.link import Link

__all__ = [
    "Answer",
    "Kind",
    "Step",
    "ask",
    "level_text",
    "number_in",
    "require_done",
    "resynchronise",
    "step_to",
    "uptime_in",
]

#: What a command is answered with: `Ok`, one line, rows up to an empty line, or rows whose end may be silence.
Kind = Literal["ok", "value", "list", "loose list"]

_END: Final = b"\r\n"
_LONGEST_LIST: Final = 10_000  # rows
_NOT_SETTLED: Final = (Treatment.RETRY, Treatment.STOP)
_MOST_ALARMS: Final = 1000
_SILENCE_S: Final = 0.2
_TRIES: Final = 3
_UPTIME: Final = re.compile(r"(\d{1,5})\s*D\s+(\d{1,2}):(\d{2}):(\d{2}(?:\.\d{1,6})?)", re.IGNORECASE)
_NUMBER: Final = re.compile(r"[+-]?(\d{1,20}(\.\d{0,20})?|\.\d{1,20})([eE][+-]?\d{1,3})?", re.ASCII)
_ADVICE: Final = "is this an RS-7, at this speed, and nobody else's?"


@dataclass(frozen=True, slots=True)
class Answer:
    """What came back on a command, and when."""

    rows: tuple[str, ...]  #: without the acknowledgement; empty for `Ok` and for a complaint
    complaint: Complaint | None
    alarms: tuple[Complaint, ...]  #: that came in between
    written_s: float  #: before the command was written, s of the clock that was given
    acknowledged_s: float  #: the empty line was here
    done_s: float  #: the answer was complete


@dataclass(frozen=True, slots=True)
class Step:
    """A level that was reached, and when, in seconds of the clock that was given."""

    written_s: float
    acknowledged_s: float  #: the unit had the command that led to the level
    settled_s: float
    alarms: tuple[Complaint, ...] = ()


class _Lines:
    """The lines of one answer, with the alarms among them set aside, until a deadline."""

    def __init__(self, link: Link, device: str, asked: str, timeout_s: float) -> None:
        self.alarms: list[Complaint] = []
        self._link = link
        self._device = device
        self._asked = asked
        self._timeout_s = timeout_s
        self._deadline = time.monotonic() + timeout_s

    def next(self, within_s: float = math.inf) -> str:
        """Return the next line that is no alarm."""
        while True:
            left_s = max(self._deadline - time.monotonic(), 0.0)
            raw = self._link.read_until(_END, self._asked, min(left_s, within_s))
            try:
                line = raw.decode("ascii")
            except UnicodeDecodeError:
                raise self.unexpected(repr(raw)) from None
            if any(not character.isprintable() for character in line):
                raise self.unexpected(repr(raw))
            complaint = complaint_in(line)
            if complaint is None or not complaint.is_alarm:
                return line
            self.alarms.append(complaint)
            if len(self.alarms) > _MOST_ALARMS:
                raise self.unexpected(f"more than {_MOST_ALARMS} alarms in one answer")

    def late(self, error: DeviceTimeout) -> DeviceTimeout:
        """Return `error`, with the alarms that came instead of an answer."""
        heard = f" (alarms: {', '.join(map(str, self.alarms))})" if self.alarms else ""
        answered = f"no whole answer within {self._timeout_s:g} s: {error.answered}{heard}"
        return DeviceTimeout(self._device, self._asked, answered, error.advice)

    def unexpected(self, what: str) -> UnexpectedAnswer:
        """Return the error for an answer that is none."""
        return UnexpectedAnswer(self._device, self._asked, what[:200], _ADVICE)


def ask(
    link: Link, device: str, command: str, kind: Kind, now: Callable[[], float], timeout_s: float | None = None
) -> Answer:
    """Send a command and return its answer; a complaint of the unit is an answer, too.

    Parameters
    ----------
    link
        The link to the unit.
    device
        Its name, for messages.
    command
        Acronym and arguments, without the CR.
    kind
        What the unit answers.
    now
        The clock whose times the answer has.
    timeout_s
        For the whole answer, s of real time; None for that of the link.

    Raises
    ------
    DeviceTimeout, UnexpectedAnswer, ConnectionFailed
        There was no whole answer.
    """
    seconds = link.timeout_s if timeout_s is None else timeout_s
    with link.exchange(command):
        written_s = now()
        link.write(command.encode("ascii") + b"\r", command)
        lines = _Lines(link, device, command, seconds)
        try:
            first = lines.next()
            acknowledged_s = now()
            if first:
                raise lines.unexpected(f"{first!r} in place of the acknowledgement")
            rows, complaint = _body(lines, kind)
        except DeviceTimeout as error:
            raise lines.late(error) from error
        return Answer(rows, complaint, tuple(lines.alarms), written_s, acknowledged_s, now())


def _body(lines: _Lines, kind: Kind) -> tuple[tuple[str, ...], Complaint | None]:
    """Return the rows that follow the acknowledgement, or the complaint in their place."""
    rows: list[str] = []
    while True:
        try:
            line = lines.next(_SILENCE_S if kind == "loose list" and (rows or lines.alarms) else math.inf)
        except DeviceTimeout:
            if kind == "loose list" and (rows or lines.alarms):
                return tuple(rows), None
            raise
        complaint = complaint_in(line)
        if complaint is not None and not rows:
            return (), complaint
        if kind == "ok":
            if line.lower() != "ok":
                raise lines.unexpected(f"{line!r} in place of Ok")
            return (), None
        if kind == "value":
            if not line or line.lower() == "ok":
                raise lines.unexpected(f"{line!r} in place of a value")
            return (line,), None
        if not line:
            return tuple(rows), None
        rows.append(line)
        if len(rows) > _LONGEST_LIST:
            raise lines.unexpected(f"a list of more than {_LONGEST_LIST} rows")


def resynchronise(link: Link, device: str, serial: str, timeout_s: float | None = None) -> None:
    """Ask for the serial number, and throw away all answers to what was asked before it.

    The unit answers in the order in which it was asked: once its serial number has come, nothing older can come.

    Raises
    ------
    DeviceTimeout, UnexpectedAnswer, ConnectionFailed
        It does not come.
    """
    asked = "fall in step with the unit (USN)"
    deadline = time.monotonic() + (link.timeout_s if timeout_s is None else timeout_s)
    link.lost_step()
    with link.exchange(asked):
        link.write(b"USN\r", asked)
        wanted = serial.encode("ascii")
        while (line := link.read_until(_END, asked, max(deadline - time.monotonic(), 0.0))) != wanted:
            if time.monotonic() > deadline:
                raise UnexpectedAnswer(device, asked, f"{line[:80]!r} and no end of it", _ADVICE)


def step_to(link: Link, device: str, level: float, now: Callable[[], float], timeout_s: float | None = None) -> Step:
    """Set a level, and again if the light did not settle or the feedback lost its lock.

    Raises
    ------
    WrongState
        The unit refuses the level.
    DeviceError
        The unit says that its light is not what it should be, or gave no whole answer.
    """
    command = f"OUT {level_text(level)}"
    first_s: float | None = None
    alarms: list[Complaint] = []
    tries = 0
    while True:
        answer = ask(link, device, command, "ok", now, timeout_s)
        first_s = answer.written_s if first_s is None else first_s
        alarms += answer.alarms
        wrong = answer.complaint or next((a for a in answer.alarms if a.treatment in _NOT_SETTLED), None)
        if wrong is None:
            return Step(first_s, answer.acknowledged_s, answer.done_s, tuple(alarms))
        tries += 1
        if wrong.treatment is not Treatment.RETRY or tries == _TRIES:
            raise complaint_raised(device, command, wrong)


def level_text(level: float) -> str:
    """Return a level as the unit reads it: a plain decimal number, not more than nine digits after the point."""
    return f"{level:.9f}".rstrip("0").rstrip(".")


def number_in(device: str, asked: str, answer: Answer) -> float:
    """Return the number that a value is.

    Raises
    ------
    UnexpectedAnswer
        It is none.
    """
    text = answer.rows[0] if answer.rows else ""
    number = float(text) if _NUMBER.fullmatch(text.strip()) else math.nan
    if not math.isfinite(number):
        raise UnexpectedAnswer(device, asked, f"{text!r} in place of a number", _ADVICE)
    return number


def uptime_in(device: str, asked: str, answer: Answer) -> float:
    """Return the time since the unit was switched on, s, from an answer such as `0D 02:09:28.736`.

    Raises
    ------
    UnexpectedAnswer
        It is no such time.
    """
    text = answer.rows[0] if answer.rows else ""
    found = _UPTIME.fullmatch(text.strip())
    if found is None:
        raise UnexpectedAnswer(device, asked, f"{text!r} in place of a time such as 0D 02:09:28.736", _ADVICE)
    days, hours, minutes, seconds = found.groups()
    return ((int(days) * 24 + int(hours)) * 60 + int(minutes)) * 60 + float(seconds)


def require_done(device: str, asked: str, answer: Answer) -> Answer:
    """Return `answer`.

    Raises
    ------
    DeviceError
        It is a complaint.
    """
    if answer.complaint is not None:
        raise complaint_raised(device, asked, answer.complaint)
    return answer
