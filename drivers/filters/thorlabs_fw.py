"""Thorlabs FW102C and FW212C filter wheels, 6 and 12 positions, over their serial port.

A command ends with CR and is echoed; a query adds its value and CR; then comes the prompt ``"> "``, after a move only
when the wheel has arrived (FW102C manual, rev. H (2014), page 11). An unknown command or a bad argument is answered
by a line that begins with ``Command error``. The unit may send NUL bytes after power-up.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from drivers.errors import ConnectionFailed, DeviceError, DeviceTimeout, UnexpectedAnswer, Unsupported, WrongState
from drivers.interfaces import Filter, FilterWheel
from drivers.transport.link import Link, shown
from drivers.transport.ports import SerialPort
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivers.interfaces import Clock
    from drivers.transport.trace import Trace

__all__ = ["ThorlabsFilterWheel", "parse_reply", "stops_on_the_way"]

_PROMPT: Final = b"> "
_MAKER: Final = "THORLABS"
_VERSION: Final = " version "
_ERROR: Final = "Command error"
_BEFORE_AGAIN_S: Final = 0.2


class ThorlabsFilterWheel(FilterWheel):
    """A wheel that is never turned through its clear position, and whose position sensors are dark.

    The sensors light up the inside of the wheel: they are switched off on :meth:`connect` and before each move. The
    buttons on the unit turn the wheel too, so each position is read back.

    Parameters
    ----------
    port
        Its serial port.
    filters
        For each filter by name: `position`, from 1, and `nd_od`, its nominal optical density.
    clock
        The time before a question is asked again passes on it.
    clear
        Name of the filter through which the wheel is never turned on its way to another; None: it does not matter.
    timeout_s
        How long an answer may take, s.
    move_timeout_s
        How long a move without a stop may take, s; it is up to 2 s for each position at the slow speed.
    baud
        Bits per second that the unit is set to.
    name
        What the operator calls it.

    Raises
    ------
    InputError
        The filters make no sense.
    """

    def __init__(
        self,
        port: str,
        *,
        filters: Mapping[str, Mapping[str, float]],
        clock: Clock,
        clear: str | None = None,
        timeout_s: float = 2.0,
        move_timeout_s: float = 20.0,
        baud: int = 115200,
        name: str = "filter wheel",
    ) -> None:
        super().__init__(name)
        self._positions = _positions(name, filters)
        self.filters = tuple(Filter(label, float(section["nd_od"])) for label, section in filters.items())
        if clear is not None and clear not in self._positions:
            raise InputError(f"{name}: clear is {clear!r}; it has {', '.join(self._positions)}")
        self._clear = None if clear is None else self._positions[clear]
        self._clock = clock
        self._link = Link(SerialPort(port, baud), name, timeout_s)
        self._move_timeout_s = move_timeout_s
        self._lost = False
        self._count = 0
        self._told = ""

    def trace_to(self, trace: Trace | None) -> None:
        """Write every byte that goes over the link into `trace` from now on; None: no more."""
        self._link.trace = trace

    def identity(self) -> dict[str, str]:
        """Return maker, model, serial number (the unit does not tell it) and firmware version."""
        self.require_connected("identify itself")
        model, _, firmware = self._told.partition(_VERSION)
        return {
            "maker": "Thorlabs",
            "model": f"{model.removeprefix(_MAKER).strip()}, {self._count} positions",
            "serial": "not told by the unit",
            "firmware": firmware.strip() or "not told by the unit",
        }

    def selected(self) -> str:
        """Return the name of the filter that is in.

        Raises
        ------
        WrongState
            The wheel stands at a position that has no filter in the station.
        """
        self.require_connected("read the position")
        position = self._position()
        for label, known in self._positions.items():
            if known == position:
                return label
        raise WrongState(
            self.name, "read the position", f"position {position} has no filter here", "were its buttons pressed?"
        )

    def _connect(self) -> None:
        self._link.open()
        self._lost = False
        try:
            self._greet()
        except DeviceError:
            self._link.close()
            raise

    def _greet(self) -> None:
        self._told = self._ask("*idn?")
        if not self._told.upper().startswith(_MAKER):
            raise ConnectionFailed(self.name, "identify itself", self._told, "is it the right port?")
        self._count = self._number("pcount?")
        label, highest = max(self._positions.items(), key=lambda item: item[1])
        if highest > self._count:
            raise ConnectionFailed(
                self.name,
                f"use position {highest} for filter {label}",
                f"it has {self._count} positions",
                "correct the filters in the station file",
            )
        self._sensors_off()
        self._position()

    def _close(self) -> None:
        self._link.close()

    def _safe_state(self) -> None:
        """No position is safer than another."""

    def _select(self, name: str) -> None:
        self._sensors_off()  # a unit that was without power has them on again
        for stop in stops_on_the_way(self._position(), self._positions[name], self._count, self._clear):
            self._exchange(f"pos={stop}", self._move_timeout_s)
            arrived = self._position()
            if arrived != stop:
                raise UnexpectedAnswer(
                    self.name, f"move to position {stop}", f"stands at {arrived}", "were its buttons pressed?"
                )

    def _sensors_off(self) -> None:
        self._ask("sensors=0")
        if self._number("sensors?") != 0:
            raise UnexpectedAnswer(
                self.name, "switch the position sensors off", "they are on", "their light reaches the camera"
            )

    def _position(self) -> int:
        position = self._number("pos?")
        if not 1 <= position <= self._count:
            raise UnexpectedAnswer(self.name, "send pos?", f"position {position} of {self._count}")
        return position

    def _number(self, query: str) -> int:
        answer = self._ask(query)
        if not answer.isdecimal():
            raise UnexpectedAnswer(self.name, f"send {query}", f"{answer!r}; expected a number")
        return int(answer)

    def _ask(self, command: str) -> str:
        """Send a command that may be repeated without harm, and return the answer; ask again if it makes no sense."""
        try:
            return self._exchange(command)
        except (DeviceTimeout, UnexpectedAnswer):
            self._clock.sleep(_BEFORE_AGAIN_S)
        answer = self._exchange(command)
        self._link.lost_step()  # if it was the late answer to the first attempt, the one to this is still to come
        return answer

    def _exchange(self, command: str, timeout_s: float | None = None) -> str:
        """Send a command, wait for the prompt, and return the answer; open the port again if it was gone."""
        asked = f"send {command}"
        if self._lost:
            self._link.close()
            self._link.open()
            self._lost = False
        try:
            with self._link.exchange(asked):
                self._link.write(command.encode("ascii") + b"\r", asked)
                return parse_reply(self.name, command, self._link.read_until(_PROMPT, asked, timeout_s))
        except ConnectionFailed:
            self._lost = True
            raise


def parse_reply(device: str, command: str, reply: bytes) -> str:
    """Return the value that answers `command`, empty for a setting.

    Parameters
    ----------
    device
        Its name, for messages.
    command
        What was sent, without its CR.
    reply
        What came until the prompt.

    Raises
    ------
    Unsupported
        The unit does not know the command, or not with this argument.
    UnexpectedAnswer
        It is no answer to this command.
    """
    asked = f"send {command}"
    text = reply.replace(b"\0", b"").decode("ascii", "replace")
    echo, cr, rest = text.partition("\r")
    value = rest.strip("\r\n")
    if echo != command or not cr:
        raise UnexpectedAnswer(device, asked, shown(reply), "is it a FW102C or FW212C, at this speed?")
    if value.startswith(_ERROR):
        raise Unsupported(device, asked, value, "is its firmware older than 1.04?")
    if not value.isprintable() or "\ufffd" in value or bool(value) != command.endswith("?"):
        raise UnexpectedAnswer(device, asked, shown(reply))
    return value


def stops_on_the_way(start: int, goal: int, count: int, clear: int | None) -> list[int]:
    """Return the positions to be moved to one after the other so that `clear` is not passed on the way to `goal`.

    The unit turns the shorter way round by itself, and that way may lead through the clear position, whose flash
    resets every pixel. Of the two ways from `start` to `goal` one is without `clear`; on it the wheel is stopped so
    often that each move is less than half a turn, and so cannot go round the other way. This is possible with any
    number of positions: with fewer than three there is nothing between two filters.

    Parameters
    ----------
    start, goal
        From where to where, from 1.
    count
        Number of positions.
    clear
        The position that is not passed; None, or one of the two ends, leaves the way to the unit.
    """
    if start == goal:
        return []
    if clear is None or clear in (start, goal):
        return [goal]
    upwards = (goal - start) % count
    step = 1 if (clear - start) % count > upwards else -1
    length = upwards if step == 1 else count - upwards
    longest = (count - 1) // 2
    return [(start - 1 + step * min(done, length)) % count + 1 for done in range(longest, length + longest, longest)]


def _positions(name: str, filters: Mapping[str, Mapping[str, float]]) -> dict[str, int]:
    """Return the position of each filter, or raise InputError with what is wrong."""
    if not filters:
        raise InputError(f"{name}: has no filters; expected one or more")
    positions: dict[str, int] = {}
    for label, section in filters.items():
        if set(section) != {"position", "nd_od"}:
            has = ", ".join(section) or "nothing"
            raise InputError(f"{name}: filter {label} has {has}; expected position and nd_od")
        position, nd_od = section["position"], section["nd_od"]
        if type(position) is not int or position < 1:
            raise InputError(f"{name}: filter {label} is at position {position!r}; expected a whole number from 1")
        if position in positions.values():
            raise InputError(f"{name}: filter {label} is at position {position}, where another one is")
        if not 0.0 <= nd_od < math.inf:
            raise InputError(f"{name}: filter {label} has optical density {nd_od}; expected 0 or more")
        positions[label] = position
    return positions
