"""The firmware of an emulated LED driver: the protocol of the sketch, on the clock of a world."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from drivers.light.led_protocol import LONGEST_LINE, encode_line, text_of_line
from sim_backend.wire.wire import Firmware

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sim_backend.world import OpticalBench

__all__ = ["LedFirmware"]

_NS_PER_US: Final = 1000
_NS_PER_MS: Final = 1_000_000
_LONGEST_US: Final = 2_000_000_000
_MOST: Final = (1 << 32) - 1
_BOOT: Final = "! boot evs-led"

_BAD_ARGUMENT: Final = "error 3 bad argument"
_OUT_OF_RANGE: Final = "error 4 out of range"
_TOO_MANY: Final = "error 5 too many edges"
_NOT_STORED: Final = "error 6 no whole waveform"
_MISMATCH: Final = "error 7 not the waveform that is stored"


class _Refused(Exception):
    """A request is answered by an error; the text is the answer."""


@dataclass
class _Wave:
    """A stored waveform."""

    begin: int = 0
    announced: int = 0
    loop_from: int = 0
    loop_edges: int = 0
    loops: int = 1
    end_us: int = 0
    edges: list[tuple[int, int]] = field(default_factory=list)

    def played(self) -> Iterator[tuple[int, int]]:
        """Yield the edges as they are played."""
        stop = self.loop_from + self.loop_edges
        yield from self.edges[: self.loop_from]
        for _ in range(self.loops):
            yield from self.edges[self.loop_from : stop]
        yield from self.edges[stop:]

    def totals(self) -> tuple[int, int]:
        """Return how many edges are played, and how long it takes, us."""
        loop = self.edges[self.loop_from : self.loop_from + self.loop_edges]
        once_us = sum(delta_us for delta_us, _ in self.edges) + self.end_us
        again_us = sum(delta_us for delta_us, _ in loop)
        return len(self.edges) + (self.loops - 1) * len(loop), once_us + (self.loops - 1) * again_us


class LedFirmware(Firmware):
    """An LED driver in a world; each edge comes at its microsecond.

    Parameters
    ----------
    world
        The world that it lights.
    rise_tau_s
        Time constant of an edge, s.
    dac_bits, max_edges, shortest_us
        What it can do, as it says to hello.
    serial
        Its serial number.
    """

    def __init__(
        self,
        world: OpticalBench,
        *,
        rise_tau_s: float = 0.0,
        dac_bits: int = 16,
        max_edges: int = 4096,
        shortest_us: int = 20,
        serial: str = "emulated",
    ) -> None:
        self._world = world
        self._dac_bits = dac_bits
        self._max_edges = max_edges
        self._shortest_us = shortest_us
        self._serial = serial
        self._last_request = b""
        self._last_answer = b""
        world.rise_tau_s = rise_tau_s
        self._start()

    def requests_in(self, buffer: bytearray) -> list[bytes]:
        """Take the whole requests off the front of `buffer`: each ends with LF."""
        *whole, rest = bytes(buffer).split(b"\n")
        buffer[:] = rest
        return whole

    def obey(self, request: bytes, send: Callable[[bytes], None]) -> None:
        """Do what a request asks, and send what the sketch sends."""
        self._watch(send)
        try:
            if len(request) >= LONGEST_LINE:
                raise ValueError
            number, _, command = text_of_line(request).partition(" ")
        except ValueError:
            send(encode_line("? error 1 garbled"))
            return
        if not number.isdecimal() or len(number) > 5:
            send(encode_line("? error 1 garbled"))
        elif request == self._last_request and command != "hello":
            send(self._last_answer)
        else:
            self._last_request = request
            self._answer(number, command, send)

    def reboot(self, send: Callable[[bytes], None]) -> None:
        """Lose the power for a moment: it is dark, and knows nothing."""
        self._world.set_level(0.0)
        self._start()
        send(encode_line(_BOOT))

    def alarm(self) -> bytes:
        """Return what it says when its watchdog has made it dark, which it is then."""
        self._world.set_level(0.0)
        self._level = 0
        self._last_request = b""  # what was answered before is no longer true
        return encode_line("! watchdog")

    def _start(self) -> None:
        self._level = 0
        self._wave: _Wave | None = None
        self._watchdog_ms = 0
        self._last_request = b""
        self._last_answer = b""
        self._heard_ns = self._world.clock.now_ns

    def _watch(self, send: Callable[[bytes], None]) -> None:
        now_ns = self._world.clock.now_ns
        if self._watchdog_ms and self._level and now_ns - self._heard_ns >= self._watchdog_ms * _NS_PER_MS:
            send(self.alarm())
        self._heard_ns = now_ns

    def _answer(self, number: str, command: str, send: Callable[[bytes], None]) -> None:
        name, *words = command.split(" ")
        try:
            if name == "play":
                self._play(number, *_numbers(words, 2), send=send)
                return
            answer = self._obeyed(name, words)
        except _Refused as refused:
            answer = str(refused)
        self._last_answer = encode_line(f"{number} {answer}")
        send(self._last_answer)

    def _obeyed(self, name: str, words: list[str]) -> str:
        """Return the answer to a command that takes no time."""
        if name == "hello":
            _numbers(words, 0)
            return (
                f"ok evs-led protocol=1 firmware=1.0 serial={self._serial} tick_us=1 dac_bits={self._dac_bits} "
                f"max_edges={self._max_edges} shortest_us={self._shortest_us}"
            )
        if name == "level":
            self._go_to(self._in_range(_numbers(words, 1)[0]))
        elif name in ("dark", "abort"):
            _numbers(words, 0)
            self._go_to(0 if name == "dark" else self._level)
        elif name == "level?":
            _numbers(words, 0)
        elif name == "status":
            _numbers(words, 0)
            stored = len(self._wave.edges) if self._wave else 0
            return f"ok level={self._level} playing=0 stored={stored} watchdog_ms={self._watchdog_ms}"
        elif name == "watchdog":
            (self._watchdog_ms,) = _numbers(words, 1)
            return "ok"
        elif name == "wave":
            return self._store_wave(*_numbers(words, 6))
        elif name == "edges":
            return self._store_edges(words)
        elif name == "square":
            return self._store_square(*_numbers(words, 6))
        else:
            raise _Refused("error 2 unknown command")
        return f"ok {self._level}"

    def _store_wave(self, begin: int, edges: int, loop_from: int, loop_edges: int, loops: int, end_us: int) -> str:
        self._wave = None
        self._in_range(begin)
        if edges > self._max_edges:
            raise _Refused(_TOO_MANY)
        loop_fits = loop_from + loop_edges <= edges and loops >= 1 and (loop_edges >= 1 or loops == 1)
        if not loop_fits or end_us > _LONGEST_US:
            raise _Refused(_OUT_OF_RANGE)
        self._wave = _Wave(begin, edges, loop_from, loop_edges, loops, end_us)
        return "ok 0"

    def _store_edges(self, words: list[str]) -> str:
        first, *pairs = words or [""]
        index = _number(first)
        new = [tuple(_number(part) for part in pair.split(":")) for pair in pairs]
        if not new or any(len(pair) != 2 for pair in new):
            raise _Refused(_BAD_ARGUMENT)
        if self._wave is None or index != len(self._wave.edges):
            raise _Refused(_NOT_STORED)
        if index + len(new) > self._wave.announced:
            raise _Refused(_TOO_MANY)
        for delta_us, level in new:
            if not self._shortest_us <= delta_us <= _LONGEST_US:
                raise _Refused(_OUT_OF_RANGE)
            self._in_range(level)
        self._wave.edges += [(delta_us, level) for delta_us, level in new]
        return f"ok {len(self._wave.edges)}"

    def _store_square(self, low: int, high: int, period_us: int, bright_us: int, count: int, preamble_us: int) -> str:
        self._wave = None
        self._in_range(low)
        self._in_range(high)
        dark_us = period_us - bright_us
        if count < 1 or not all(self._shortest_us <= t <= _LONGEST_US for t in (bright_us, dark_us, preamble_us)):
            raise _Refused(_OUT_OF_RANGE)
        edges = [(preamble_us, high), (bright_us, low), (dark_us, high), (bright_us, low)]
        if count == 1:
            self._wave = _Wave(low, 2, 0, 2, 1, dark_us, edges[:2])
        else:
            self._wave = _Wave(low, 4, 1, 2, count - 1, dark_us, edges)
        return f"ok {len(self._wave.edges)}"

    def _play(self, number: str, edges: int, duration_us: int, *, send: Callable[[bytes], None]) -> None:
        wave = self._wave
        if wave is None or len(wave.edges) != wave.announced:
            raise _Refused(_NOT_STORED)
        if wave.totals() != (edges, duration_us):
            raise _Refused(_MISMATCH)
        send(encode_line(f"{number} ok"))
        clock = self._world.clock
        now_ns = clock.now_ns
        end_ns = now_ns + duration_us * _NS_PER_US
        self._go_to(wave.begin)
        for delta_us, level in wave.played():
            now_ns += delta_us * _NS_PER_US
            clock.advance_to(now_ns)
            rising = level >= self._level
            self._go_to(level)
            self._world.emit_trigger(rising=rising)
        clock.advance_to(end_ns)
        self._heard_ns = clock.now_ns
        self._last_answer = encode_line(f"{number} done {edges} 0")
        send(self._last_answer)

    def _go_to(self, level: int) -> None:
        self._level = level
        self._world.set_level(float(level))

    def _in_range(self, level: int) -> int:
        if level >= 1 << self._dac_bits:
            raise _Refused(_OUT_OF_RANGE)
        return level


def _number(word: str) -> int:
    """Return a whole number of 32 bits, or refuse."""
    if not word.isdecimal() or len(word) > 10 or int(word) > _MOST:
        raise _Refused(_BAD_ARGUMENT)
    return int(word)


def _numbers(words: list[str], count: int) -> list[int]:
    """Return so many numbers, or refuse."""
    if len(words) != count:
        raise _Refused(_BAD_ARGUMENT)
    return [_number(word) for word in words]
