"""The talk of a driver with its RS-7: commands one after the other, in step with their answers."""

from __future__ import annotations

import contextlib
import logging
from typing import TYPE_CHECKING, Final

from drivers.errors import ConnectionFailed, DeviceTimeout, UnexpectedAnswer
from drivers.light.rs7_answers import ask, number_in, require_done, resynchronise, step_to, uptime_in

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers.interfaces import Clock
    from drivers.light.rs7_answers import Answer, Kind, Step
    from drivers.light.rs7_errors import Complaint
    from drivers.transport.link import Link

__all__ = ["Talk"]

_log = logging.getLogger("evs_bench.devices")

_MOST_ALARMS: Final = 1000


class Talk:
    """Commands and answers, with the alarms that came in between set aside.

    Parameters
    ----------
    link
        The link to the unit.
    name
        Of the unit, for messages.
    clock
        Of the station.
    """

    def __init__(self, link: Link, name: str, clock: Clock) -> None:
        self.name = name
        self.link = link
        self.serial = ""  #: serial number of the unit, once it is known: by it the two get in step again
        self.alarms: list[Complaint] = []  #: all that came, oldest first
        self._clock = clock
        self._in_doubt = False

    def ask(self, command: str, kind: Kind, timeout_s: float | None = None) -> Answer:
        """Return what a command is answered with; a complaint of the unit is an answer, too.

        Raises
        ------
        DeviceTimeout, UnexpectedAnswer, ConnectionFailed
            There was no whole answer.
        """
        with self.in_step():
            answer = ask(self.link, self.name, command, kind, self._clock.now, timeout_s)
        self.note(answer.alarms)
        return answer

    def do(self, command: str) -> None:
        """Have a command carried out that is answered with Ok.

        Raises
        ------
        DeviceError
            It was not.
        """
        require_done(self.name, command, self.ask(command, "ok"))

    def value(self, command: str) -> str:
        """Return what a command is answered with, one line; raises as :meth:`do`."""
        return require_done(self.name, command, self.ask(command, "value")).rows[0].strip()

    def number(self, command: str) -> float:
        """Return what a command is answered with, a number; raises as :meth:`do`."""
        return number_in(self.name, command, require_done(self.name, command, self.ask(command, "value")))

    def rows(self, command: str, kind: Kind = "list", timeout_s: float | None = None) -> tuple[str, ...]:
        """Return what a command is answered with, several lines; raises as :meth:`do`."""
        return require_done(self.name, command, self.ask(command, kind, timeout_s)).rows

    def uptime_s(self) -> float:
        """Return for how long the unit has been switched on, s; raises as :meth:`do`."""
        return uptime_in(self.name, "POT", require_done(self.name, "POT", self.ask("POT", "value")))

    def step_to(self, level: float) -> Step:
        """Set a level, and return when it was reached; raises as :func:`drivers.light.rs7_answers.step_to`."""
        with self.in_step():
            step = step_to(self.link, self.name, level, self._clock.now)
        self.note(step.alarms)
        return step

    def note(self, alarms: tuple[Complaint, ...]) -> None:
        """Write alarms down."""
        for alarm in alarms:
            _log.warning("%s: alarm %s", self.name, alarm)
        self.alarms = (self.alarms + list(alarms))[-_MOST_ALARMS:]

    def lost_step(self) -> None:
        """Say that an answer to an earlier command may still come."""
        self._in_doubt = True

    def reopen(self) -> None:
        """Open the link anew: the cable was out.

        Raises
        ------
        ConnectionFailed
            It still is.
        """
        self.link.close()
        self.link.open()
        self._in_doubt = True

    @contextlib.contextmanager
    def in_step(self) -> Iterator[None]:
        """Get in step, if an answer may still come, before something is asked; and remember if one did not come."""
        try:
            if self._in_doubt and self.serial:
                resynchronise(self.link, self.name, self.serial)
            self._in_doubt = False
            yield
        except (ConnectionFailed, DeviceTimeout, UnexpectedAnswer):
            self._in_doubt = True
            raise
