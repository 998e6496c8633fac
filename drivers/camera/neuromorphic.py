"""The EVK4 through the package neuromorphic-drivers: another way to the same camera, to compare with.

Only what version 0.18.2 of the package documents is used. It has no read-back of dead time and biases, and does not
switch filters one by one. Its masks and its raw stream count rows as the sensor does.
"""

from __future__ import annotations

import importlib
import math
import queue
import threading
from concurrent.futures import Future
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np

from drivers.camera.evk4.biases import table_limits
from drivers.camera.evk4.masks import HEIGHT, WIDTH
from drivers.camera.evk4.spool import Lost, Spool
from drivers.camera.evk4.timeline import Timeline
from drivers.errors import ConnectionFailed, DeviceError, DeviceTimeout, WrongState
from drivers.interfaces import EventCamera, Limits, RecordingQuality
from protocols.points import Roi

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from drivers.events.types import EventChunk
    from drivers.interfaces import Clock, Recording

__all__ = ["NeuromorphicCamera"]

_T = TypeVar("_T")

_PACKAGE: Final = "neuromorphic-drivers"
_MODULE: Final = "neuromorphic_drivers"
_VERSION: Final = "0.18.2"
_NEXT_S: Final = 0.05  # for which the package waits for a packet; the camera sends one every 4 ms
_LONGEST_CALL_S: Final = 60.0
_TAIL_S: Final = 0.1
_PREFIX: Final = "bias_"


class _Owner(threading.Thread):
    """The one thread that touches the camera: it does what it is asked to, and takes packets in between."""

    def __init__(self, device: Any, name: str) -> None:
        super().__init__(name=f"{name}: packets", daemon=True)
        self.spool: Spool | None = None  #: where packets go; None: none are taken
        self.bytes_received = 0
        self.dropped = 0
        self.failure: Exception | None = None  #: why the stream broke off
        self.quiet = threading.Event()  #: set when no packet came in time
        self._device = device
        self._asked: queue.SimpleQueue[tuple[Future[Any], Callable[[Any], Any]] | None] = queue.SimpleQueue()

    def ask(self, question: Callable[[Any], _T]) -> Future[_T]:
        """Let the thread call `question` with the camera."""
        answer: Future[_T] = Future()
        self._asked.put((answer, question))
        return answer

    def end(self) -> None:
        """End the thread."""
        self._asked.put(None)
        self.join(_LONGEST_CALL_S)

    def run(self) -> None:
        """Do what is asked, until the end."""
        while True:
            try:
                item = self._asked.get(block=self.spool is None)
            except queue.Empty:
                self._take_packet()
                continue
            if item is None:
                return
            answer, question = item
            try:
                answer.set_result(question(self._device))
            except Exception as error:  # noqa: BLE001 - whoever asked gets it
                answer.set_exception(error)

    def _take_packet(self) -> None:
        spool = self.spool
        if spool is None:
            return
        try:
            status, packet = next(self._device)
            ring = status.ring
            if ring is not None and ring.dropped_packets:
                self.dropped += ring.dropped_packets
                spool.note_lost(Lost(ring.dropped_packets, 0, 0.0))
            if packet:
                self.bytes_received += len(packet)
                spool.write(packet)
        except Exception as error:  # noqa: BLE001 - the package raises what it likes; who stops the recording gets it
            self.failure, self.spool, packet = error, None, None
        if not packet:
            self.quiet.set()


class NeuromorphicCamera(EventCamera):
    """An EVK4 through neuromorphic-drivers 0.18.2, which must be installed.

    The biases that are returned are those that were asked for: the package cannot read them back.

    Parameters
    ----------
    clock
        Whose time a recording takes.
    serial
        Serial number; None for the first EVK4.
    library
        What is used in place of the package; None to import it.
    name
        What the operator calls it.
    """

    def __init__(self, *, clock: Clock, serial: str | None = None, library: Any = None, name: str = "camera") -> None:
        super().__init__(name)
        self.width = WIDTH
        self.height = HEIGHT
        self.bias_limits = table_limits()
        self._clock = clock
        self._serial = serial
        self._library = library
        self._module: Any = None
        self._owner: _Owner | None = None
        self._offsets = dict.fromkeys(self.bias_limits, 0)
        self._roi = Roi(0, 0, WIDTH, HEIGHT)
        self._start_s: float | None = None
        self._taken: tuple[Spool, float] | None = None
        self._quality: RecordingQuality | None = None

    def identity(self) -> dict[str, str]:
        """Return maker, model, serial number and firmware version; the package does not tell the last."""
        self.require_connected("identify itself")
        serial = str(self._call("tell the serial number", lambda device: device.serial()))
        return {"maker": "Prophesee", "model": "EVK4 IMX636", "serial": serial.lower(), "firmware": "not told"}

    def biases(self) -> dict[str, int]:
        """Return all bias offsets as they were asked for."""
        self.require_connected("read the biases")
        return dict(self._offsets)

    def refractory_s(self) -> float:
        """Return NaN: the package has no such reading."""
        self.require_connected("measure the dead time")
        return math.nan

    def temperature_c(self) -> float:
        """Return the temperature of the sensor, degrees Celsius."""
        self.require_connected("read the temperature")
        return float(self._call("read the temperature", lambda device: device.temperature_celsius()))

    def start(self, recording: Recording) -> None:  # noqa: ARG002 - a camera knows its own light
        """Start a recording; time is 0 now."""
        self.require_connected("start a recording")
        self._require_idle("start a recording")
        self._forget()
        owner = self._connected()
        owner.bytes_received, owner.dropped, owner.failure = 0, 0, None
        self._call("throw away old packets", lambda device: device.clear_backlog(0))
        owner.spool = Spool(self.name)
        self._start_s = self._clock.now()
        self._configure(output=True)

    def stop(self) -> None:
        """Stop the recording; what was recorded can still be read."""
        self.require_connected("stop the recording")
        if self._start_s is None:
            raise WrongState(self.name, "stop the recording", "no recording is running", "call start() first")
        owner, duration_s = self._connected(), self._clock.now() - self._start_s
        spool = owner.spool
        self._configure(output=False)
        owner.quiet.clear()
        if owner.failure is None and not owner.quiet.wait(_LONGEST_CALL_S):
            raise DeviceTimeout(self.name, "stop the recording", "packets go on coming", "unplug it once")
        self._start_s, owner.spool = None, None
        if owner.failure is not None or spool is None:
            raise ConnectionFailed(
                self.name, "stop the recording", f"the stream broke off: {owner.failure}", "was it unplugged?"
            )
        spool.finish(whole=True)
        self._taken = (spool, duration_s)

    def chunks(self) -> Iterator[EventChunk]:
        """Yield the last recording, in the order in which it came. It can be read again."""
        self.require_connected("read the recording")
        self._require_idle("read the recording")
        if self._taken is None:
            raise WrongState(self.name, "read the recording", "nothing was recorded", "call start() and stop() first")
        return self._decoded(*self._taken)

    def quality(self) -> RecordingQuality:
        """Return what is known about the completeness of the last recording; it is decoded for that, if need be."""
        self.require_connected("judge the recording")
        if self._taken is not None and self._quality is None:
            for _ in self._decoded(*self._taken):
                """Only the counts are of interest."""
        return self._quality or RecordingQuality()

    def _connect(self) -> None:
        self._module = self._imported()
        self._offsets = dict.fromkeys(self.bias_limits, 0)
        self._roi = Roi(0, 0, WIDTH, HEIGHT)
        try:
            device = self._module.open(
                configuration=self._configuration(output=False),
                iterator_timeout=_NEXT_S,
                raw=True,
                serial=self._serial,
            )
            device.__enter__()
        except Exception as error:
            raise ConnectionFailed(
                self.name, "open it", str(error), "is it plugged in, and nobody else's?"
            ) from error
        self._owner = _Owner(device, self.name)
        self._owner.start()
        bounds = self._call("tell the limits of the biases", lambda device: device.biases_bounds())
        self.bias_limits = {name: _within(limits, bounds, name) for name, limits in table_limits().items()}

    def _close(self) -> None:
        self._forget()
        owner, self._owner, self._start_s = self._owner, None, None
        if owner is not None:
            owner.spool = None
            try:
                owner.ask(lambda device: device.__exit__(None, None, None)).result(_LONGEST_CALL_S)
            finally:
                owner.end()

    def _safe_state(self) -> None:
        if self._start_s is not None:
            self.stop()

    def _set_roi(self, roi: Roi) -> None:
        self._require_idle("set the window")
        self._roi = roi
        self._configure(output=False)

    def _set_biases(self, offsets: Mapping[str, int]) -> None:
        self._require_idle("set biases")
        self._offsets = dict(offsets)
        self._configure(output=False)

    def _imported(self) -> Any:
        """Return the package, if it is the right one."""
        if self._library is not None:
            return self._library
        try:
            found = version(_PACKAGE)
        except PackageNotFoundError:
            found = "not installed"
        if found != _VERSION:
            raise ConnectionFailed(
                self.name, f"import {_PACKAGE}", f"it is {found}", f"pip install {_PACKAGE}=={_VERSION}"
            )
        return importlib.import_module(_MODULE)

    def _configuration(self, *, output: bool) -> Any:
        evk4 = self._module.prophesee_evk4
        return evk4.Configuration(
            biases=evk4.Biases(**{name.removeprefix(_PREFIX): offset for name, offset in self._offsets.items()}),
            x_mask=_mask(self._roi.x, self._roi.width, WIDTH),
            y_mask=_mask(self._roi.y, self._roi.height, HEIGHT),
            enable_external_trigger=True,
            enable_output=output,
        )

    def _configure(self, *, output: bool) -> None:
        configuration = self._configuration(output=output)
        self._call("take its settings", lambda device: device.update_configuration(configuration))

    def _call(self, asked: str, question: Callable[[Any], _T]) -> _T:
        """Return what the package says to a question."""
        try:
            return self._connected().ask(question).result(_LONGEST_CALL_S)
        except TimeoutError as error:
            raise DeviceTimeout(
                self.name, asked, f"nothing within {_LONGEST_CALL_S:g} s", "unplug it once"
            ) from error
        except DeviceError:
            raise
        except Exception as error:
            raise ConnectionFailed(self.name, asked, str(error), "was it unplugged?") from error

    def _decoded(self, spool: Spool, duration_s: float) -> Iterator[EventChunk]:
        owner, timeline = self._connected(), Timeline(WIDTH, HEIGHT)
        for piece in spool.pieces():
            if isinstance(piece, Lost):
                timeline.lose(piece)
            else:
                yield from timeline.feed(piece)
        timeline.finish(duration_s, _TAIL_S)
        gaps_s = tuple((begin / 1e6, end / 1e6) for begin, end in timeline.gaps_us)
        self._quality = RecordingQuality(
            owner.bytes_received, timeline.violations, owner.dropped, timeline.overflows, gaps_s
        )

    def _forget(self) -> None:
        taken, self._taken, self._quality = self._taken, None, None
        if taken is not None:
            taken[0].close()

    def _connected(self) -> _Owner:
        if self._owner is None:
            raise WrongState(self.name, "use it", "not connected", "call connect() first")
        return self._owner

    def _require_idle(self, asked: str) -> None:
        if self._start_s is not None:
            raise WrongState(self.name, asked, "a recording is running", "call stop() first")


def _mask(first: int, count: int, size: int) -> tuple[int, ...]:
    """Return a mask of lines as the package has it: 64 bits in a word, 1 for off."""
    off = np.ones(-(-size // 64) * 64, bool)
    off[first : first + count] = False
    off[size:] = False
    return tuple(int(word) for word in np.packbits(off, bitorder="little").view("<u8"))


def _within(limits: Limits, bounds: Any, name: str) -> Limits:
    """Return the limits of a bias, as far as the camera has codes for them."""
    bound = getattr(bounds, name.removeprefix(_PREFIX))
    return Limits(max(limits.lowest, bound.minimum), min(limits.highest, bound.maximum), limits.unit)
