"""What an emulated function generator does with its output, and the LED behind it; the language is its maker's."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from sim_backend.clock import to_ns
from sim_backend.wire.scpi_samples import Refused, block_of, requests_of
from sim_backend.wire.wire import Firmware

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from sim_backend.world import OpticalBench

__all__ = ["OPEN_OHM", "UNKNOWN", "EmulatedGenerator", "GeneratorSettings", "number_in", "switched"]

OPEN_OHM: Final = 9.9e37
_RESOLUTION_V: Final = 1e-4
UNKNOWN: Final = (-113, "Undefined header")
_WRONG: Final = (-224, "Illegal parameter value")
_BEYOND: Final = (-222, "Data out of range")
_CONFLICT: Final = (-221, "Settings conflict")
_BAD_BLOCK: Final = (-161, "Invalid block data")
_SAMPLED: Final = ("USER", "ARB")


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
    memory: dict[str, npt.NDArray[np.float64]] = field(default_factory=dict)  #: samples by name, 0 to 1
    samples: str = ""  #: name of those that it plays
    sample_rate_hz: float = 1e6
    sample_mode: str = "FREQ"  #: how fast it plays samples: by the frequency of the cycle, or "RATE"
    between_samples: str = "LINE"
    sample_filter: str = "NORM"
    byte_order: str = "NORM"


class EmulatedGenerator(Firmware):
    """One channel of a generator whose voltage drives an LED in a world: 1 V is level 1, and 0 V and less is dark.

    It knows square waves and samples in bursts, and the level that it holds between them; a burst takes place in the
    moment of its trigger, in which the time of the world passes to its last edge. Its sync output rises when a burst
    begins and falls when it is over, as the manuals have it. Anything else that lights the LED (a sine, a wave
    without burst) is emulated as its upper level.

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
        return requests_of(buffer)

    def obey(self, request: bytes, send: Callable[[bytes], None]) -> None:
        """Do what a line asks, and send the answer to a question."""
        try:
            block = block_of(request)
            if block is not None:
                self._take_in(*block)
                self._show()
                return
        except Refused:
            self._error(_BAD_BLOCK)
            return
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

    @abstractmethod
    def _take_in(self, head: str, data: bytes) -> None:
        """Take samples into the memory; raise :class:`~sim_backend.wire.scpi_samples.Refused` if that cannot be."""

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
        if not self._is_armed():
            return settings.high_v
        if settings.function == "SQU":
            first_v = settings.high_v if settings.phase_deg % 360.0 < 360.0 * settings.duty else settings.low_v
        else:
            first_v = self._volts(float(self._cycle()[0]))
        middle_v = (settings.high_v + settings.low_v) / 2.0
        return {"FPT": first_v, "TOP": settings.high_v, "CENTER": middle_v, "BOTTOM": settings.low_v}[settings.idle]

    def _is_armed(self) -> bool:
        settings = self.settings
        plays = settings.function == "SQU" or (settings.function in _SAMPLED and settings.samples in settings.memory)
        return settings.burst and settings.burst_trigger in ("MAN", "BUS") and plays

    def _cycle(self) -> npt.NDArray[np.float64]:
        """Return the samples of a cycle, from the one at which a burst starts."""
        samples = self.settings.memory[self.settings.samples]
        return np.roll(samples, -int(self.settings.phase_deg / 360.0 % 1.0 * len(samples)))

    def _volts(self, share: float) -> float:
        settings = self.settings
        return settings.low_v + share * (settings.high_v - settings.low_v)

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

    def _set_rate(self, rate_hz: float) -> None:
        if not 1e-6 <= rate_hz <= 250e6:
            self._error(_BEYOND)
        else:
            self.settings.sample_rate_hz = rate_hz

    def _trigger(self) -> None:
        """Play a burst: its edges come at their times, and the sync output is high meanwhile."""
        settings, clock = self.settings, self._world.clock
        if not self._is_armed():
            self._error((-211, "Trigger ignored"))
            return
        begin_ns = clock.now_ns
        self._sync(rising=True)
        square = settings.function == "SQU"
        for at_s, share in self._edges() if square else self._steps():
            clock.advance_to(begin_ns + to_ns(at_s))
            if settings.output:
                self._world.set_level(self._level(self._volts(share)))
        lasts_s = settings.cycles * (1.0 / settings.frequency_hz if square else self._cycle_s())
        self._sync(rising=False, at_ns=begin_ns + to_ns(lasts_s))

    def _sync(self, *, rising: bool, at_ns: int | None = None) -> None:
        """Send an edge to the camera's trigger input, now or when its time will have come."""
        if self.settings.sync:
            self._world.emit_trigger(rising=rising, at_ns=at_ns)

    def _cycle_s(self) -> float:
        """Return how long a cycle of samples takes, s."""
        settings = self.settings
        by_frequency = settings.sample_mode == "FREQ"
        return 1.0 / settings.frequency_hz if by_frequency else len(self._cycle()) / settings.sample_rate_hz

    def _steps(self) -> list[tuple[float, float]]:
        """Return the steps of a burst of samples: when, and where to."""
        cycle, cycle_s = self._cycle(), self._cycle_s()
        at = np.flatnonzero(np.diff(cycle, append=cycle[0])) + 1
        return [
            ((number + index / len(cycle)) * cycle_s, float(cycle[index % len(cycle)]))
            for number in range(self.settings.cycles)
            for index in at.tolist()
        ]

    def _edges(self) -> list[tuple[float, float]]:
        """Return the edges of a burst of a square wave: when, and where to."""
        settings = self.settings
        period_s, first = 1.0 / settings.frequency_hz, settings.phase_deg / 360.0 % 1.0
        at_high = first < settings.duty
        edges = [(0.0, 1.0)] if at_high and self._rest_v() < settings.high_v else []
        for cycle in range(settings.cycles):
            fall = (cycle + settings.duty - first) * period_s
            rise = (cycle + 1.0 - first) * period_s
            if at_high:
                edges += [(fall, 0.0), (rise, 1.0)]
            else:
                edges += [(rise, 1.0), (fall + period_s, 0.0)]
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
