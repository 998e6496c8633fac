"""The EVK4 as an event camera."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from drivers.camera.evk4 import filters, masks, monitoring, sequences
from drivers.camera.evk4 import registers as reg
from drivers.camera.evk4.biases import Biases, table_limits
from drivers.camera.evk4.registers import Registers
from drivers.camera.evk4.spool import Lost, Spool, raw_path
from drivers.camera.evk4.stream import StreamReader
from drivers.camera.evk4.timeline import Timeline
from drivers.camera.evk4.treuzell import EVENTS, Property, Treuzell
from drivers.errors import ConnectionFailed, DataLost, DeviceError, WrongState
from drivers.events.encode import raw_header
from drivers.interfaces import EventCamera, RecordingQuality
from drivers.transport.usb_link import UsbLink
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from drivers.events.types import EventChunk
    from drivers.interfaces import Clock, Recording
    from drivers.transport.trace import Trace
    from protocols.points import Roi

__all__ = ["Evk4"]

_log = logging.getLogger("evs_bench.devices")

_VENDOR: Final = 0x04B4
_PRODUCT: Final = 0x00F5
_COMPATIBLE: Final = "psee,ccam5_imx636"
_CHIP_ID: Final = 0xA0401806
_OLDEST_RELEASE: Final = (3, 8, 0)
_OLDEST_WITH_ALTERNATE: Final = 0x0307  # of the USB descriptor's release number
_TAIL_S: Final = 0.02  # by which a sound recording may end earlier than the computer's clock says


@dataclass(frozen=True, slots=True)
class _Running:
    """A recording that is running."""

    reader: StreamReader
    spool: Spool
    start_s: float


@dataclass(frozen=True, slots=True)
class _Take:
    """A recording that was stopped."""

    spool: Spool
    duration_s: float
    bytes_received: int
    dropped_transfers: int
    broke_off: DeviceError | None


class Evk4(EventCamera):
    """A Prophesee EVK4 (IMX636, 1280 x 720) through pyusb.

    After connect() all pixels are on, the biases are the factory's, and nothing stands between pixels and stream:
    anti-flicker filter, noise filter and event-rate controller are off, which is read back. The trigger input is on.
    The time axis begins at 0 with each start(): the first step of the camera's own count (4096 us) is time 0.

    Ranges of the biases are the recommended ones; once connected, they are cut to what this unit has codes for.

    Parameters
    ----------
    serial
        Serial number, eight hexadecimal digits; None if there is only one EVK4.
    clock
        Whose time passes while the sensor powers up.
    backend
        A backend of pyusb; None for libusb.
    transfer_bytes
        Size of a transfer of the stream.
    transfers
        Number of such buffers between the thread that reads the stream and the one that keeps it.
    raw_folder
        Where each recording is kept as a RAW file as well, named after its label; None for nowhere.
    trigger_inverted
        Whether the trigger input turns edges round.
    name
        What the operator calls it.
    """

    def __init__(
        self,
        *,
        serial: str | None = None,
        clock: Clock,
        backend: Any = None,
        transfer_bytes: int = 131072,
        transfers: int = 256,
        raw_folder: Path | str | None = None,
        trigger_inverted: bool = False,
        name: str = "camera",
    ) -> None:
        super().__init__(name)
        if transfer_bytes < 1024 or transfer_bytes % 1024:
            raise InputError(f"{name}: transfer_bytes is {transfer_bytes}; expected a multiple of 1024")
        if transfers < 2:
            raise InputError(f"{name}: transfers is {transfers}; expected 2 or more")
        self.width = masks.WIDTH
        self.height = masks.HEIGHT
        self.bias_limits = table_limits()
        self._clock = clock
        self._wanted_serial = serial
        self._link = UsbLink(_VENDOR, _PRODUCT, name, backend=backend)
        self._treuzell = Treuzell(self._link, name)
        self._registers = Registers(self._treuzell)
        self._transfer_bytes = transfer_bytes
        self._transfers = transfers
        self._raw_folder = None if raw_folder is None else Path(raw_folder)
        self._trigger_inverted = trigger_inverted
        self._identity: dict[str, str] = {}
        self._biases: Biases | None = None
        self._running: _Running | None = None
        self._take: _Take | None = None
        self._quality: RecordingQuality | None = None

    def trace_to(self, trace: Trace | None) -> None:
        """Write all questions and answers into `trace` from now on; None: no more. The stream is not in it."""
        self._link.trace = trace

    def identity(self) -> dict[str, str]:
        """Return maker, model, serial number and firmware version."""
        self.require_connected("identify itself")
        return dict(self._identity)

    def biases(self) -> dict[str, int]:
        """Return all bias offsets as read back from the sensor."""
        return self._unit("read the biases").offsets()

    def factory_codes(self) -> dict[str, int]:
        """Return the codes that the biases of this unit have at offset 0."""
        return dict(self._unit("tell the factory codes").factory_codes)

    def refractory_s(self) -> float:
        """Return the dead time as the sensor measures it, s; NaN if it does not."""
        self.require_connected("measure the dead time")
        return monitoring.dead_time_s(self._registers, self._clock)

    def temperature_c(self) -> float:
        """Return the temperature of the sensor, degrees Celsius; NaN if it does not say."""
        self.require_connected("read the temperature")
        return monitoring.temperature_c(self._registers, self._clock)

    def illumination_counter(self) -> int | None:
        """Return the raw counter of the light on the array, the smaller the brighter; None if it is too dark."""
        self.require_connected("measure the light")
        return monitoring.illumination_counter(self._registers, self._clock)

    def illumination_lux(self) -> float:
        """Return the light on the array by the maker's formula, lux, which nobody has calibrated; NaN for none."""
        return monitoring.lux_from_counter(self.illumination_counter())

    def start(self, recording: Recording) -> None:
        """Start a recording; time is 0 now."""
        self.require_connected("start a recording")
        self._require_idle("start a recording")
        self._forget()
        filters.require_off(self._registers, self.name)
        self._link.clear_halt(EVENTS, "start a recording")  # before a read is queued: never after
        spool = self._new_spool(recording.label)
        reader = StreamReader(
            self._link, spool, self.name, transfer_bytes=self._transfer_bytes, transfers=self._transfers
        )
        self._running = _Running(reader, spool, self._clock.now())
        try:
            reader.start()  # before the sensor: what it sends must be waited for
            sequences.run(sequences.START, self._registers, self._clock)
        except BaseException:
            self.safe_state()
            raise
        self._running = _Running(reader, spool, self._clock.now())

    def stop(self) -> None:
        """Stop the recording; what was recorded can still be read.

        Raises
        ------
        DeviceError
            The camera does not obey, or what came could not be kept; what is known to be there can be read.
        """
        self.require_connected("stop the recording")
        if self._running is None:
            raise WrongState(self.name, "stop the recording", "no recording is running", "call start() first")
        self._end(self._running)

    def chunks(self) -> Iterator[EventChunk]:
        """Yield the last recording in the order in which it came; it must have been stopped. It can be read again."""
        self.require_connected("read the recording")
        self._require_idle("read the recording")
        return self._decoded(self._last_take("read the recording"))

    def quality(self) -> RecordingQuality:
        """Return what is known about the completeness of the last recording; it is decoded for that, if need be."""
        self.require_connected("judge the recording")
        self._require_idle("judge the recording")
        if self._take is None:
            return RecordingQuality()
        if self._quality is None:
            for _ in self._decoded(self._take):
                """Only the counts are of interest."""
        return self._quality or RecordingQuality()

    def _connect(self) -> None:
        if self._running is not None:
            self._abandon(self._running)  # of a camera that was unplugged meanwhile
        self._link.close()
        self._link.open(self._wanted_serial, self._ask_serial)
        try:
            self._identity = self._checked_identity()
            self._power_up()
        except BaseException:
            self._link.close()
            raise

    def _close(self) -> None:
        """Power the sensor down, and let go; where it does not obey, it is let go of all the same."""
        self._forget()
        if self._running is not None:
            self._abandon(self._running)
        try:
            sequences.run(sequences.DESTROY, self._registers, self._clock)
        except DeviceError as error:
            _log.warning("%s", error)
        finally:
            self._link.close()

    def _safe_state(self) -> None:
        if self._running is not None:
            self._end(self._running)

    def _set_roi(self, roi: Roi) -> None:
        self._require_idle("set the window")
        masks.set_window(self._registers, roi)

    def _set_biases(self, offsets: Mapping[str, int]) -> None:
        self._require_idle("set biases")
        self._unit("set biases").set(offsets)

    def _ask_serial(self) -> str:
        """Return the serial number of the camera that is open."""
        if self._link.bcd_device >= _OLDEST_WITH_ALTERNATE:
            self._link.set_alternate("make it ready")
        return f"{self._treuzell.number(Property.SERIAL, 'ask for the serial number'):08x}"

    def _checked_identity(self) -> dict[str, str]:
        """Make sure that this is an EVK4 whose firmware is known, and return who it is."""
        serial = self._ask_serial()
        word = self._treuzell.number(Property.RELEASE_VERSION, "ask for the release")
        release = (word >> 16 & 0xFF, word >> 8 & 0xFF, word & 0xFF)
        version = ".".join(str(part) for part in release)
        if release < _OLDEST_RELEASE:
            oldest = ".".join(str(part) for part in _OLDEST_RELEASE)
            raise ConnectionFailed(
                self.name, "check its firmware", f"it is release {version}", f"update it to {oldest} or later"
            )
        compatible = self._treuzell.texts(Property.DEVICE_COMPATIBLE, "ask for the model")
        chip, variant = self._registers.read(reg.CHIP_ID), self._registers.read(reg.VARIANT)
        if _COMPATIBLE not in compatible or chip != _CHIP_ID or variant & 0b11:
            found = f"{', '.join(compatible) or 'nameless'}, chip 0x{chip:08X}, variant 0x{variant:X}"
            raise ConnectionFailed(self.name, "check the model", found, "is it an EVK4 with an IMX636?")
        if not self._link.is_super_speed:
            _log.warning("%s: connected by USB 2: it will lose events at high rates", self.name)
        return {"maker": "Prophesee", "model": "EVK4 IMX636", "serial": serial, "firmware": version}

    def _power_up(self) -> None:
        """Bring the sensor from whatever it is in to ready, with nothing between pixels and stream."""
        before_biases = (
            sequences.STOP,
            sequences.DESTROY,
            sequences.INIT,
            sequences.MONITORING,
            sequences.EVENT_RATE_CONTROLLER,
        )
        for steps in before_biases:
            sequences.run(steps, self._registers, self._clock)
        self._biases = Biases(self._registers, self.name)
        self.bias_limits = self._biases.limits()
        sequences.run(sequences.PIXELS_AND_TIME_BASE, self._registers, self._clock)
        filters.switch_off(self._registers, self.name)
        self._registers.change(reg.TRIGGER_CTRL, reg.TRIGGER_ENABLE, reg.TRIGGER_ENABLE)
        if not self._registers.read(reg.TRIGGER_CTRL) & reg.TRIGGER_ENABLE:
            raise DeviceError(self.name, "switch the trigger input on", "it reads back as off", "connect it anew")

    def _new_spool(self, label: str) -> Spool:
        if self._raw_folder is None:
            return Spool(self.name)
        try:
            self._raw_folder.mkdir(parents=True, exist_ok=True)
            return Spool(self.name, raw_header(self.width, self.height), raw_path(self._raw_folder, label))
        except OSError as error:
            raise DataLost(self.name, "keep the recording as a RAW file", str(error), "see to the folder") from error

    def _end(self, running: _Running) -> None:
        """Stop the sensor, read what is still to come, and keep it."""
        stop_s = self._clock.now()
        sequences.run(sequences.STOP, self._registers, self._clock)
        running.reader.finish()
        self._running = None
        reader = running.reader
        try:
            running.spool.finish(whole=reader.failure is None)
        except OSError as error:
            reader.failure = DataLost(self.name, "keep the recording", str(error), "make room on the disk")
        self._take = _Take(
            running.spool,
            stop_s - running.start_s,
            reader.bytes_received,
            reader.dropped_transfers + reader.unkept_transfers,
            reader.failure,
        )
        if reader.failure is not None:
            raise reader.failure

    def _abandon(self, running: _Running) -> None:
        """Let go of a recording whose end the camera did not obey."""
        self._running = None
        try:
            running.reader.finish()
        except DeviceError as error:
            _log.warning("%s", error)
        else:
            running.spool.close()

    def _decoded(self, take: _Take) -> Iterator[EventChunk]:
        timeline = Timeline(self.width, self.height, trigger_inverted=self._trigger_inverted)
        for piece in take.spool.pieces():
            if isinstance(piece, Lost):
                timeline.lose(piece)
            else:
                yield from timeline.feed(piece)
        if take.broke_off is not None:
            timeline.lose(Lost(0, 0, 0.0))
        timeline.finish(take.duration_s, _TAIL_S)
        self._quality = RecordingQuality(
            bytes_received=take.bytes_received,
            decode_errors=timeline.violations,
            dropped_buffers=take.dropped_transfers,
            overflows=timeline.overflows,
            gaps_s=tuple((begin / 1e6, end / 1e6) for begin, end in timeline.gaps_us),
        )

    def _forget(self) -> None:
        """Let go of the last recording."""
        take, self._take, self._quality = self._take, None, None
        if take is not None:
            take.spool.close()

    def _last_take(self, asked: str) -> _Take:
        if self._take is None:
            raise WrongState(self.name, asked, "nothing was recorded", "call start() and stop() first")
        return self._take

    def _unit(self, asked: str) -> Biases:
        self.require_connected(asked)
        if self._biases is None:
            raise WrongState(self.name, asked, "its biases are not known", "connect it anew")
        return self._biases

    def _require_idle(self, asked: str) -> None:
        if self._running is not None:
            raise WrongState(self.name, asked, "a recording is running", "call stop() first")
