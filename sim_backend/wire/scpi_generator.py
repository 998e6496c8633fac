"""What an emulated function generator does with its output, and the LED behind it; the language is its maker's."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

from sim_backend.clock import to_ns
from sim_backend.wire.wire import Firmware

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim_backend.world import OpticalBench

__all__ = ["OPEN_OHM", "UNKNOWN", "EmulatedGenerator", "GeneratorSettings", "number_in", "switched"]

OPEN_OHM: Final = 9.9e37
_RESOLUTION_V: Final = 1e-4
_LONGEST_LINE: Final = 4096  # bytes
UNKNOWN: Final = (-113, "Undefined header")
_WRONG: Final = (-224, "Illegal parameter value")
_BEYOND: Final = (-222, "Data out of range")
_CONFLICT: Final = (-221, "Settings conflict")


@dataclass
class GeneratorSettings:
    """What a generator has in its memory, as after switching on; for 50 ohm, as all of them are then."""

    function: str = "SIN"
    frequency_hz: float = 1000.0
    duty: float = 0.5
    high_v: float = 0.05  #: at the load that it believes in
    low_v: float = -0.05
    phase_deg: float = 0.0
    burst: bool = False
    burst_trigger: str = "INT"
    burst_mode: str = "TRIG"
    cycles: int = 1
    idle: str = "FPT"
    sync: bool = False
    output: bool = False
    load_ohm: float = 50.0


class EmulatedGenerator(Firmware):
    """One channel of a generator whose voltage drives an LED in a world: 1 V is level 1, and 0 V and less is dark.

    It knows square waves in bursts, and the lower level that it holds between them; a burst takes place in the
    moment of its trigger, in which the time of the world passes to the end of its last pulse. Anything else that
    lights the LED (a sine, a wave without burst) is emulated as its upper level.

    Parameters
    ----------
    world
        The world that is lit.
    wired_to
        What its output is really connected to: "high_z", or 50 (ohm).
    rise_tau_s
        Time constant of an edge of the LED, s.
    """

    identity: str
    duty_limits = (0.0001, 0.9999)
    no_error = '0,"No error"'

    def __init__(
        self, world: OpticalBench, *, wired_to: Literal["high_z", 50] = "high_z", rise_tau_s: float = 0.0
    ) -> None:
        self.settings = GeneratorSettings()
        self._world = world
        self._ohm = OPEN_OHM if wired_to == "high_z" else 50.0
        self._errors: list[tuple[int, str]] = []
        world.rise_tau_s = rise_tau_s

    def requests_in(self, buffer: bytearray) -> list[bytes]:
        """Take the whole lines off the front of `buffer`, and return them; what is not whole stays."""
        *lines, rest = bytes(buffer).split(b"\n")
        buffer[:] = rest[-_LONGEST_LINE:]
        return lines

    def obey(self, request: bytes, send: Callable[[bytes], None]) -> None:
        """Do what a line asks, and send the answer to a question."""
        line = request.decode("ascii", "replace").strip()
        if not line:
            return
        answer = self._common(line.upper())
        if answer is None:
            try:
                answer = self._own(line)
            except ValueError:
                self._error(_WRONG)
                answer = ""
        self._show()
        if answer:
            send(answer.encode() + b"\n")

    def reboot(self, send: Callable[[bytes], None]) -> None:  # noqa: ARG002 - it comes back without a word
        """Lose the power for a moment: the output is off, and all settings are forgotten."""
        self.settings = GeneratorSettings()
        self._errors.clear()
        self._show()

    @abstractmethod
    def _own(self, line: str) -> str:
        """Obey a line in the maker's own dialect; a `ValueError` is an illegal parameter."""

    def _common(self, line: str) -> str | None:
        """Obey what all of them know; None if it is not among that."""
        if line == "*IDN?":
            return self.identity
        if line == "*OPC?":
            return "1"
        if line == "*CLS":
            self._errors.clear()
            return ""
        if line.lstrip(":") == "SYST:ERR?":
            return '{:d},"{}"'.format(*self._errors.pop(0)) if self._errors else self.no_error
        return None

    def _error(self, error: tuple[int, str]) -> None:
        self._errors.append(error)

    def _true_v(self, volts: float) -> float:
        """Return the voltage at the real load: behind its own 50 ohm, the generator drives what it believes in."""
        open_v = volts * (2.0 if self.settings.load_ohm < OPEN_OHM else 1.0)
        return open_v * (0.5 if self._ohm < OPEN_OHM else 1.0)

    def _level(self, volts: float) -> float:
        return max(self._true_v(volts), 0.0)

    def _rest_v(self) -> float:
        """Return the voltage that the output has while nothing is played."""
        settings = self.settings
        armed = settings.burst and settings.burst_trigger in ("MAN", "BUS") and settings.function == "SQU"
        if not armed:
            return settings.high_v
        first_v = settings.high_v if settings.phase_deg % 360.0 < 360.0 * settings.duty else settings.low_v
        middle_v = (settings.high_v + settings.low_v) / 2.0
        return {"FPT": first_v, "TOP": settings.high_v, "CENTER": middle_v, "BOTTOM": settings.low_v}[settings.idle]

    def _show(self) -> None:
        self._world.set_level(self._level(self._rest_v()) if self.settings.output else 0.0)

    def _set_levels(self, *, low_v: float | None = None, high_v: float | None = None) -> None:
        settings = self.settings
        low = settings.low_v if low_v is None else round(low_v / _RESOLUTION_V) * _RESOLUTION_V
        high = settings.high_v if high_v is None else round(high_v / _RESOLUTION_V) * _RESOLUTION_V
        most = 10.0 if settings.load_ohm == OPEN_OHM else 5.0
        if not -most <= low < high <= most:
            self._error(_BEYOND)
        else:
            settings.low_v, settings.high_v = low, high

    def _set_duty(self, duty: float) -> None:
        lowest, highest = self.duty_limits
        self.settings.duty = min(max(duty, lowest), highest)
        if self.settings.duty != duty:
            self._error(_CONFLICT)

    def _set_load(self, ohm: float) -> None:
        """Believe in another load: the voltage at the output stays, what is told of it changes."""
        settings = self.settings
        if ohm != settings.load_ohm:
            factor = 2.0 if ohm == OPEN_OHM else 0.5
            settings.load_ohm, settings.low_v, settings.high_v = (
                ohm,
                settings.low_v * factor,
                settings.high_v * factor,
            )

    def _set_cycles(self, cycles: float) -> None:
        self.settings.cycles = int(cycles)

    def _set_frequency(self, frequency_hz: float) -> None:
        if not 1e-6 <= frequency_hz <= 25e6:
            self._error(_BEYOND)
        else:
            self.settings.frequency_hz = frequency_hz

    def _trigger(self) -> None:
        """Play a burst: its edges, and those of the sync output, come at their times."""
        settings, clock = self.settings, self._world.clock
        if not (settings.burst and settings.function == "SQU" and settings.burst_trigger in ("MAN", "BUS")):
            self._error((-211, "Trigger ignored"))
            return
        begin_ns = clock.now_ns
        for at_s, high in self._edges():
            clock.advance_to(begin_ns + to_ns(at_s))
            if settings.output:
                self._world.set_level(self._level(settings.high_v if high else settings.low_v))
            if settings.sync:
                self._world.emit_trigger(rising=high)

    def _edges(self) -> list[tuple[float, bool]]:
        """Return the edges of a burst: when, and whether they rise."""
        settings = self.settings
        period_s, first = 1.0 / settings.frequency_hz, settings.phase_deg / 360.0 % 1.0
        at_high = first < settings.duty
        edges = [(0.0, True)] if at_high and self._rest_v() < settings.high_v else []
        for cycle in range(settings.cycles):
            fall = (cycle + settings.duty - first) * period_s
            rise = (cycle + 1.0 - first) * period_s
            if at_high:
                edges += [(fall, False), (rise, True)]
            else:
                edges += [(rise, True), (fall + period_s, False)]
        # A burst from the upper level ends where it began, before the last rise unless it began later than that.
        return edges[:-1] if at_high and first == 0.0 else edges


def number_in(text: str) -> float:
    """Return the number that a parameter is; a `ValueError` if it is none."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(text)
    return number


def switched(text: str) -> bool:
    """Return whether a parameter says on; a `ValueError` if it says neither on nor off."""
    if text not in ("ON", "1", "OFF", "0"):
        raise ValueError(text)
    return text in ("ON", "1")
