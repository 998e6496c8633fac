"""The sensor of an emulated EVK4: what its registers mean for the pixels of the world, and what it sends."""

from __future__ import annotations

import errno
from typing import TYPE_CHECKING, Final

import numpy as np

from drivers.events.encode import Evt3Encoder
from drivers.events.types import EventChunk, empty_events
from drivers.interfaces import Recording
from protocols.points import Roi
from sim_backend.clock import NS_PER_S
from sim_backend.devices.camera import SimulatedCamera
from sim_backend.wire.evk4_registers import FACTORY_CODES, PIXELS_RELEASED, ROI_APPLY, ROI_CTRL, Refused
from sim_backend.wire.faults import Fault

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Literal

    import numpy.typing as npt

    from sim_backend.devices.camera import BiasBehaviour
    from sim_backend.wire.evk4_registers import RegisterFile
    from sim_backend.world import OpticalBench

__all__ = ["Evk4Sensor"]

_WIDTH: Final = 1280
_HEIGHT: Final = 720
_STEP_US: Final = 4096
_US_PER_S: Final = 1e6
_TIME_HIGH: Final = 0x8

_BIAS_NAMES: Final = {
    0x1004: "bias_fo",
    0x100C: "bias_hpf",
    0x1010: "bias_diff_on",
    0x1014: "bias_diff",
    0x1018: "bias_diff_off",
    0x1020: "bias_refr",
}
_ROI_ENABLE: Final = 1 << 1
_ROI_INSIDE: Final = 1 << 6
_TRIGGER_CTRL: Final = 0x7004
_TRIGGER_ENABLE: Final = 1 << 10
_SHARE_MISSED: Final = 0.3  # of the trigger edges


class Evk4Sensor:
    """The pixels of the world behind the registers of an EVK4.

    A recording lasts from the write that releases the pixels to the one that holds them; what the stream then has
    to say is computed at once.

    Parameters
    ----------
    world
        The world whose light it sees.
    registers
        What rules it; its status registers are made to tell what the sensor measures.
    bias_behaviour, dt_s, engine
        See :class:`sim_backend.devices.camera.SimulatedCamera`.
    seed
        Of what faults do to a recording.
    """

    def __init__(
        self,
        world: OpticalBench,
        registers: RegisterFile,
        *,
        bias_behaviour: BiasBehaviour,
        dt_s: float,
        engine: Literal["fast", "reference"] | None,
        seed: int,
    ) -> None:
        self.stream = b""  #: what the last recording has to say
        self.replays = False  #: whether the recording is one that was given
        self.begun = 0  #: recordings
        self.ended = 0
        self.faults: list[Fault] = []  #: what befalls the recording that is running, or else the next one
        self._world = world
        self._registers = registers
        self._known = dict(bias_behaviour.ranges)
        self._camera = SimulatedCamera(world, bias_behaviour=bias_behaviour, dt_s=dt_s, engine=engine)
        self._camera.connect()
        self._random = np.random.default_rng(seed)
        self._expected = Recording()
        self._window: Roi | None = Roi(0, 0, _WIDTH, _HEIGHT)
        self._begin_ns: int | None = None
        self._replay: bytes | None = None
        registers.on_write = self._written
        registers.live.update({0x0010: self._light, 0x0020: self._dead_time, 0x0050: self._temperature})

    def expect(self, recording: Recording) -> None:
        """Hear what a real camera is not told of the next recording: its seed, and what surrounds the sensor."""
        self._expected = recording

    def replay(self, stream: bytes) -> None:
        """Send these words from the start of the next recording on, whatever the pixels do."""
        self._replay = stream

    def power_off(self) -> None:
        """Forget what was running."""
        self._begin_ns, self.stream = None, b""
        self._camera.safe_state()

    def _written(self, address: int, value: int) -> None:
        if address == ROI_CTRL:
            if value & ROI_APPLY:
                self._window = self._masked(value)
            if value & PIXELS_RELEASED and self._begin_ns is None:
                self._begin()
            elif not value & PIXELS_RELEASED and self._begin_ns is not None:
                self._end(self._begin_ns)
        elif address == 0x400004 and value:
            self._window = Roi(0, 0, _WIDTH, _HEIGHT)

    def _begin(self) -> None:
        self.stream, self._replay = self._replay or b"", None
        self.replays = bool(self.stream)
        self._set_biases()
        if self._window is not None:
            self._camera.set_roi(self._window)
        self._camera.start(self._expected)
        self.begun += 1
        self._begin_ns = self._world.clock.now_ns

    def _end(self, begin_ns: int) -> None:
        self._begin_ns = None
        self._camera.stop()
        duration_us = int((self._world.clock.now_ns - begin_ns) * _US_PER_S / NS_PER_S)
        if not self.replays:
            self.stream = self._encoded(duration_us)
            if Fault.OVERFLOW in self.faults:
                self.stream = self._overflown(self.stream)
        self.ended += 1
        self.faults.clear()
        self._expected = Recording()

    def _encoded(self, duration_us: int) -> bytes:
        """Return the words of the recording; they say each step of time, until its end."""
        encoder = Evt3Encoder(_WIDTH, _HEIGHT)
        last_us = -_STEP_US
        parts = []
        for chunk in self._chunks():
            last_us = max([int(a["t"][-1]) for a in (chunk.events, chunk.triggers) if len(a)], default=last_us)
            parts.append(encoder.feed(chunk.events, chunk.triggers))
        idle = np.arange(last_us // _STEP_US + 1, duration_us // _STEP_US + 1) & 0xFFF | _TIME_HIGH << 12
        return b"".join([*parts, idle.astype("<u2").tobytes()])

    def _chunks(self) -> Iterator[EventChunk]:
        """Yield events and triggers, as far as registers and faults let them through."""
        wired = bool(self._registers.values[_TRIGGER_CTRL] & _TRIGGER_ENABLE)
        for chunk in self._camera.chunks():
            events = chunk.events if self._window is not None else empty_events()
            triggers = chunk.triggers if wired else chunk.triggers[:0]
            yield EventChunk(events, self._disturbed(triggers))

    def _disturbed(self, triggers: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
        if Fault.TRIGGERS_MISSED in self.faults:
            triggers = triggers[self._random.random(len(triggers)) >= _SHARE_MISSED]
        if Fault.TRIGGERS_SWAPPED in self.faults:
            triggers = triggers.copy()
            triggers["p"] ^= 1
        return triggers

    def _overflown(self, stream: bytes) -> bytes:
        """Lose a stretch of the stream with at least one TIME_HIGH in it, and go on at the next TIME_HIGH."""
        words = np.frombuffer(stream, "<u2", len(stream) // 2)
        places = np.flatnonzero(words >> 12 == _TIME_HIGH)
        if len(places) < 3:
            return stream
        first = int(self._random.integers(0, len(places) - 2))
        last = int(self._random.integers(first + 2, min(first + 2 + len(places) // 4, len(places))))
        begin = int(self._random.integers(places[first] + 1, places[first + 1] + 1))
        return words[:begin].tobytes() + words[places[last] :].tobytes()

    def _masked(self, ctrl: int) -> Roi | None:
        """Return the window that the masks leave, None if they leave no pixel."""
        if not ctrl & _ROI_ENABLE:
            return Roi(0, 0, _WIDTH, _HEIGHT)
        if not ctrl & _ROI_INSIDE:
            raise Refused(errno.ENOSYS, "a window that is left out is not emulated")
        columns, rows = self._enabled(0x2000, _WIDTH), self._enabled(0x4000, _HEIGHT)
        if len(columns) == 0 or len(rows) == 0:
            return None
        if len(columns) != columns[-1] - columns[0] + 1 or len(rows) != rows[-1] - rows[0] + 1:
            raise Refused(errno.ENOSYS, "only a window in one piece is emulated")
        return Roi(int(columns[0]), int(rows[0]), len(columns), len(rows))

    def _enabled(self, first: int, size: int) -> npt.NDArray[np.int64]:
        """Return the lines whose bit is 0."""
        values = self._registers.values
        words = np.array([values[first + 4 * k] for k in range(-(-size // 32))], "<u4")
        off = np.unpackbits(words.view(np.uint8), bitorder="little")[:size]
        return np.flatnonzero(off == 0)

    def _set_biases(self) -> None:
        """Set the biases that do something in this sensor."""
        values = self._registers.values
        offsets = {name: (values[address] & 0xFF) - FACTORY_CODES[address] for address, name in _BIAS_NAMES.items()}
        self._camera.set_biases({name: offset for name, offset in offsets.items() if name in self._known})

    def _temperature(self, written: int) -> int:
        code = round((self._world.temperature_c + 56.0) / 0.190)
        started = self._registers.values[0x004C] & 0b110
        return written | min(max(code, 0), 0x3FF) | (1 << 11 if started == 0b110 else 0)

    def _light(self, written: int) -> int:
        lux = self._world.lux()
        counts = 0.0 if lux <= 0.0 else 10.0**3.5 / (0.37 * lux) * 100.0
        is_on = self._registers.values[0x000C] & 0b111 == 0b111
        return written | round(counts) | 1 << 29 if is_on and 0.0 < counts < 1 << 29 else written

    def _dead_time(self, written: int) -> int:
        if written >> 30 != 0b11:
            return written
        if self._begin_ns is None:
            self._set_biases()
        return written & ~((1 << 28) - 1) | round(self._camera.refractory_s() * 200e6) & (1 << 28) - 1 | 1 << 28
