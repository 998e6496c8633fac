"""The firmware of an emulated Thorlabs FW102C or FW212C filter wheel."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sim_backend.wire.wire import Firmware

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sim_backend.world import OpticalBench

__all__ = ["ThorlabsFwFirmware"]

_IDN: Final = b"THORLABS FW102C/FW212C Filter Wheel version 1.04"
_PROMPT: Final = b"> "
_AT_POWER_UP: Final = b"\0\0"
_FACTORY: Final = {"trig": 0, "speed": 1, "sensors": 1, "baud": 1}


class ThorlabsFwFirmware(Firmware):
    """A wheel that turns the shorter way round, and has each filter that it passes in the light for a moment.

    Parameters
    ----------
    world
        The world in whose light path it stands.
    filters
        Name and nominal optical density by position, from position 1, which is in to begin with.
    step_s
        From one position to the next, s.
    """

    def __init__(self, world: OpticalBench, *, filters: Sequence[tuple[str, float]], step_s: float = 0.5) -> None:
        self._world = world
        self._filters = list(filters)
        self._step_s = step_s
        self.position = 1
        #: What can be set to 0 or 1. The light of the position sensors is not in the world's light.
        self.settings = dict(_FACTORY)
        self._saved = dict(_FACTORY)
        self._show()

    def requests_in(self, buffer: bytearray) -> list[bytes]:
        """Take the whole requests off the front of `buffer`: each ends with CR."""
        *whole, rest = bytes(buffer).split(b"\r")
        buffer[:] = rest
        return whole

    def obey(self, request: bytes, send: Callable[[bytes], None]) -> None:
        """Do what a request asks, and send echo, answer and prompt; the prompt of a move comes when it is over."""
        send(request + b"\r")
        answer = self._answer(request.decode("ascii", "replace"))
        send(answer + _PROMPT)

    def reboot(self, send: Callable[[bytes], None]) -> None:
        """Lose the power for a moment: what was not saved is as it came from the factory, the wheel stays."""
        self.settings = dict(self._saved)
        send(_AT_POWER_UP)

    def press_button(self) -> None:
        """Turn the wheel to the next position, as a button on the unit does."""
        self._turn(1)

    def _answer(self, command: str) -> bytes:
        if command == "*idn?":
            return _IDN + b"\r"
        if command == "save":
            self._saved = dict(self.settings)
            return b""
        name, query, rest = command.partition("?")
        if query and not rest:
            values = {"pos": self.position, "pcount": len(self._filters), **self.settings}
            return b"%d\r" % values[name] if name in values else _error("CMD_NOT_DEFINED")
        name, _, argument = command.partition("=")
        return self._set(name, int(argument) if argument.isdecimal() else -1)

    def _set(self, name: str, value: int) -> bytes:
        if name == "pos" and 1 <= value <= len(self._filters):
            self._move(value)
        elif name in self.settings and value in (0, 1):
            self.settings[name] = value
        elif name == "pcount" and value == len(self._filters):
            pass
        else:
            return _error("CMD_ARG_INVALID" if name in ("pos", "pcount", *self.settings) else "CMD_NOT_DEFINED")
        return b""

    def _move(self, goal: int) -> None:
        count = len(self._filters)
        upwards = (goal - self.position) % count
        step = 1 if upwards <= count - upwards else -1
        while self.position != goal:
            self._turn(step)

    def _turn(self, step: int) -> None:
        self._world.clock.sleep(self._step_s)
        self.position = (self.position - 1 + step) % len(self._filters) + 1
        self._show()

    def _show(self) -> None:
        self._world.set_filter(*self._filters[self.position - 1])


def _error(code: str) -> bytes:
    return b"Command error " + code.encode("ascii") + b"\n\r"
