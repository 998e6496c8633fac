"""A light source with a microcontroller that times the edges itself, in whole microseconds.

Its firmware is the sketch in `drivers/firmware/led_driver`, which is also where the protocol is described.
"""

from __future__ import annotations

import logging
import time
from typing import TYPE_CHECKING, Final

from drivers.errors import (
    ConnectionFailed,
    DataLost,
    DeviceError,
    DeviceTimeout,
    UnexpectedAnswer,
    Unsupported,
    WrongState,
)
from drivers.interfaces import LightSource, Limits, PlayedWaveform
from drivers.light.led_program import CannotPlay, Program, program_of
from drivers.light.led_protocol import (
    PROTOCOL,
    DeviceFacts,
    Reply,
    encode_line,
    encode_program,
    parse_facts,
    parse_reply,
)
from drivers.transport.link import Link, shown
from drivers.transport.ports import SerialPort
from protocols.errors import InputError

if TYPE_CHECKING:
    from drivers.interfaces import Clock, Waveform
    from drivers.transport.trace import Trace

__all__ = ["LedDriver"]

_log = logging.getLogger("evs_bench.devices")

#: Opening the port resets an Arduino: so often is it greeted, each time for as long as an answer may take.
_GREETINGS: Final = 5
_NUMBERS: Final = 10000
_STRAY_LINES: Final = 20
_LATE_US: Final = 20  # an edge that was later than this is told
#: What is assumed of the device until it has said it: the sketch as it is shipped.
_ASSUMED: Final = DeviceFacts(PROTOCOL, "", "", tick_us=1, dac_bits=16, max_edges=4096, shortest_us=20)


class LedDriver(LightSource):
    """An LED behind the DAC of a microcontroller; the level is the number that is written to the DAC.

    Times of a waveform that are not whole microseconds (or ticks of a slower board) are rounded;
    :class:`~drivers.interfaces.PlayedWaveform` has them as played.

    Parameters
    ----------
    port
        Its serial port.
    clock
        The clock of the station: the end of a waveform is waited for on it.
    lowest, highest
        Limits of the level; 0 (dark) is always allowed.
    unit
        Of the level.
    edge_time_s
        10 % to 90 % of a step, as measured with a photodiode, s.
    settling_s
        From a step until the light is stable, s.
    timeout_s
        How long an answer may take, s.
    watchdog_s
        The device goes dark by itself when it is lit, plays nothing, and was told nothing for so long, s; 0: never.
        It must be longer than the longest pause of a measurement.
    baud
        Bits per second; boards with USB of their own ignore it.
    name
        What the operator calls it.

    Raises
    ------
    InputError
        An argument is out of range.
    """

    def __init__(
        self,
        port: str,
        *,
        clock: Clock,
        lowest: int,
        highest: int = 65535,
        unit: str = "count",
        edge_time_s: float,
        settling_s: float,
        timeout_s: float = 1.0,
        watchdog_s: float = 0.0,
        baud: int = 115200,
        name: str = "light source",
    ) -> None:
        super().__init__(name)
        if not 0 < lowest < highest <= 65535 or lowest != int(lowest) or highest != int(highest):
            raise InputError(f"{name}: limits are {lowest} to {highest}; expected whole numbers from 1 to 65535")
        for what, value in (("edge_time_s", edge_time_s), ("settling_s", settling_s), ("watchdog_s", watchdog_s)):
            if not 0.0 <= value <= 86400.0:
                raise InputError(f"{name}: {what} is {value}; expected 0 to 86400 s")
        self.timing = "device"
        self.level_step = 1.0
        self.limits = Limits(lowest, highest, unit)
        self.edge_time_s = edge_time_s
        self.settling_s = settling_s
        self._clock = clock
        self._watchdog_s = watchdog_s
        self._link = Link(SerialPort(port, baud), name, timeout_s)
        self._facts = _ASSUMED
        self._number = 0
        self._lost = False

    def trace_to(self, trace: Trace | None) -> None:
        """Write every byte that goes over the link into `trace` from now on; None: no more."""
        self._link.trace = trace

    def identity(self) -> dict[str, str]:
        """Return maker, model, serial number and firmware version."""
        self.require_connected("identify itself")
        model = f"LED driver, protocol {self._facts.protocol}, {self._facts.dac_bits} bit"
        return {
            "maker": "EVS bench",
            "model": model,
            "serial": self._facts.serial,
            "firmware": self._facts.firmware,
        }

    def level(self) -> float:
        """Return the level as read back from the device."""
        self.require_connected("read the level")
        return float(self._level_in(self._request("level?", "read the level"), "read the level"))

    def why_not(self, waveform: Waveform) -> str:
        """Return why the device cannot time a waveform, for people; empty if it can. It need not be connected."""
        try:
            self._program(waveform)
        except CannotPlay as error:
            return str(error)
        return ""

    def _program(self, waveform: Waveform) -> Program:
        facts = self._facts
        return program_of(waveform, tick_us=facts.tick_us, max_edges=facts.max_edges, shortest_us=facts.shortest_us)

    def _connect(self) -> None:
        self._link.open()
        try:
            self._greet()
        except DeviceError:
            self._link.close()
            raise
        self._lost = False

    def _close(self) -> None:
        self._link.close()

    def _safe_state(self) -> None:
        try:
            self._request("dark", "go dark", calm=True)
        except DeviceError:
            self._lost = True  # once more, from the beginning
            self._request("dark", "go dark", calm=True)

    def _set_level(self, level: float) -> None:
        asked = f"set level to {level:g} {self.limits.unit}"
        got = self._level_in(self._request(f"level {int(level)}", asked), asked)
        if got != int(level):
            raise UnexpectedAnswer(self.name, asked, f"it is at {got}")

    def _play(self, waveform: Waveform) -> PlayedWaveform:
        program = self._program(waveform)
        for text in encode_program(program):
            self._request(text, "store a waveform")
        asked = f"play {program.edges} edges in {program.duration_us / 1e6:g} s"
        text = f"play {program.edges} {program.duration_us}"
        done = self._request(text, asked, play_s=program.duration_us / 1e6)
        self._require_whole(done, program, asked)
        return PlayedWaveform(program.t_us / 1e6)

    def _require_whole(self, done: Reply, program: Program, asked: str) -> None:
        """Raise unless all edges were played; tell if they were late."""
        try:
            edges, late_us = (int(word) for word in done.words)
        except ValueError:
            raise UnexpectedAnswer(self.name, asked, f"done {' '.join(done.words)}") from None
        if edges != program.edges:
            raise DataLost(self.name, asked, f"it stopped after {edges}", "did something else use its port?")
        if late_us > _LATE_US:
            _log.warning("%s: %s: an edge came %d us late", self.name, asked, late_us)

    def _level_in(self, reply: Reply, asked: str) -> int:
        if len(reply.words) != 1 or not reply.words[0].isdecimal():
            raise UnexpectedAnswer(self.name, asked, f"{reply.kind} {' '.join(reply.words)}; expected a level")
        return int(reply.words[0])

    def _greet(self) -> None:
        """Find the device, and learn what it can do."""
        asked = "say hello"
        self._next_number()
        for greeting in range(_GREETINGS):
            try:
                reply = self._exchange("hello", asked, calm=True)
                break
            except (DeviceTimeout, UnexpectedAnswer):
                if greeting == _GREETINGS - 1:
                    raise
        try:
            facts = parse_facts(reply.words)
        except ValueError as error:
            raise UnexpectedAnswer(self.name, asked, f"{' '.join(reply.words)}: {error}") from None
        advice = "load the sketch that came with this software"
        if facts.protocol != PROTOCOL:
            raise ConnectionFailed(self.name, asked, f"protocol {facts.protocol}; expected {PROTOCOL}", advice)
        if self.limits.highest > (1 << facts.dac_bits) - 1:
            raise ConnectionFailed(
                self.name,
                f"use levels up to {self.limits.highest:g}",
                f"its DAC has {facts.dac_bits} bits",
                f"highest is {(1 << facts.dac_bits) - 1} at most",
            )
        self._facts = facts
        self._ask(f"watchdog {round(self._watchdog_s * 1e3)}", "set the watchdog", calm=True)

    def _request(self, text: str, asked: str, *, calm: bool = False, play_s: float | None = None) -> Reply:
        """Send a request and return the answer; find the device again first if it was gone."""
        if self._lost:
            self._link.close()
            self._link.open()
            self._greet()
            self._lost = False
        try:
            return self._ask(text, asked, calm=calm, play_s=play_s)
        except ConnectionFailed:
            self._lost = True
            raise

    def _ask(self, text: str, asked: str, *, calm: bool = False, play_s: float | None = None) -> Reply:
        """Send a request, once more if its answer makes no sense, and return the answer.

        The number is the same, so that the device answers again and does not obey twice.
        """
        self._next_number()
        try:
            return self._exchange(text, asked, calm=calm, play_s=play_s)
        except (DeviceTimeout, UnexpectedAnswer):
            return self._exchange(text, asked, calm=calm, play_s=play_s)

    def _next_number(self) -> None:
        self._number = self._number % _NUMBERS + 1

    def _exchange(self, text: str, asked: str, *, calm: bool = False, play_s: float | None = None) -> Reply:
        """Send a line and return its answer; with `play_s`, the one that comes when a waveform is over."""
        begin_s = self._clock.now()
        with self._link.exchange(asked):
            self._link.write(encode_line(f"{self._number} {text}"), asked)
            reply = self._answer(asked, calm)
            if play_s is not None and reply.kind == "ok":
                reply = self._end_of_play(asked, begin_s, play_s)
        if reply.kind == "error":
            raise Unsupported(self.name, asked, " ".join(reply.words), "does its firmware fit this software?")
        return reply

    def _end_of_play(self, asked: str, begin_s: float, play_s: float) -> Reply:
        """Return the answer that comes when the waveform is over, on the clock of the station."""
        begin_real_s = time.monotonic()
        while True:
            over = self._clock.now() - begin_s >= play_s or time.monotonic() - begin_real_s >= play_s
            try:
                return self._answer(asked, calm=False)
            except DeviceTimeout:
                if over:
                    raise

    def _answer(self, asked: str, calm: bool) -> Reply:
        """Return the next line that belongs to the request; what nobody asked for is bad news, unless `calm`."""
        for _ in range(_STRAY_LINES):
            line = self._link.read_until(b"\n", asked)
            try:
                reply = parse_reply(line)
            except ValueError as error:
                raise UnexpectedAnswer(self.name, asked, f"{shown(line)}: {error}") from None
            if reply.number == self._number:
                return reply
            if reply.number is None and reply.kind == "error":
                raise UnexpectedAnswer(self.name, asked, " ".join(reply.words))
            if reply.number is None:
                self._lost = self._lost or reply.kind == "boot"  # what it was set to has to be set again
                if not calm:
                    self._bad_news(reply, asked)
        raise UnexpectedAnswer(self.name, asked, f"{_STRAY_LINES} lines that belong to nothing")

    def _bad_news(self, reply: Reply, asked: str) -> None:
        if reply.kind == "boot":
            raise ConnectionFailed(self.name, asked, "it has just started anew, and is dark", "is its supply good?")
        if reply.kind == "watchdog":
            advice = "choose a longer watchdog_s, or stay in touch with it"
            raise WrongState(self.name, asked, "its watchdog has made it dark", advice)
        raise UnexpectedAnswer(self.name, asked, f"{reply.kind} {' '.join(reply.words)}")
