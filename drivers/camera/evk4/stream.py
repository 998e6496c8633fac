"""The event stream as it comes: one thread reads transfers, another keeps them.

The reader must always be waiting for the next transfer, or the camera overflows. So it does nothing else: it fills
buffers of a pool that has a fixed size. When the pool is empty because the computer is busy elsewhere, whole
transfers are read and thrown away, and are counted: never is anything lost that nobody knows of. Once the sensor is
stopped, the camera can wait for a buffer.
"""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
import time
from array import array
from typing import TYPE_CHECKING, Final

from drivers.camera.evk4.spool import Lost
from drivers.camera.evk4.treuzell import EVENTS
from drivers.errors import DataLost, DeviceError, DeviceTimeout

if TYPE_CHECKING:
    from drivers.camera.evk4.spool import Spool
    from drivers.transport.usb_link import UsbLink

__all__ = ["StreamReader"]

_log = logging.getLogger("evs_bench.devices")

_TIMEOUT_S: Final = 0.1  # of a transfer: the camera sends something every 4 ms
_READY_S: Final = 5.0
_LONGEST_END_S: Final = 60.0
_ASKED: Final = "read the event stream"

_Item = tuple["array[int]", int, Lost | None]


class StreamReader:
    """Reads the stream of one recording into a spool.

    Parameters
    ----------
    link
        To the camera.
    spool
        Where the bytes go.
    device
        Name of the camera, for messages.
    transfer_bytes
        Size of a transfer.
    transfers
        Number of buffers in the pool.

    Attributes
    ----------
    failure
        Why the stream broke off, None if it did not.
    bytes_received
        So much came, kept or not.
    dropped_transfers
        So many transfers were thrown away because the pool was empty.
    unkept_transfers
        So many could not be put into the spool.
    """

    def __init__(self, link: UsbLink, spool: Spool, device: str, *, transfer_bytes: int, transfers: int) -> None:
        self.failure: DeviceError | None = None
        self.bytes_received = 0
        self.dropped_transfers = 0
        self.unkept_transfers = 0
        self._link = link
        self._spool = spool
        self._device = device
        self._free: queue.SimpleQueue[array[int]] = queue.SimpleQueue()
        self._still_to_make = transfers
        self._transfer_bytes = transfer_bytes
        self._scratch = self._new_buffer()
        self._full: queue.SimpleQueue[_Item | None] = queue.SimpleQueue()
        self._waiting = threading.Event()
        self._ending = threading.Event()
        self._reader = threading.Thread(target=self._read, name=f"{device}: stream", daemon=True)
        self._keeper = threading.Thread(target=self._keep, name=f"{device}: spool", daemon=True)

    def start(self) -> None:
        """Begin to read, and return when the first transfer is waited for."""
        self._keeper.start()
        self._reader.start()
        if not self._waiting.wait(_READY_S):
            raise DeviceTimeout(self._device, _ASKED, f"no thread began within {_READY_S:g} s", "is it overloaded?")

    def finish(self) -> None:
        """Read until nothing comes any more, and end; the sensor must have been stopped.

        Raises
        ------
        DeviceTimeout
            The stream does not end.
        """
        self._ending.set()
        for thread in (self._reader, self._keeper):
            thread.join(_LONGEST_END_S)
            if thread.is_alive():
                raise DeviceTimeout(
                    self._device, _ASKED, f"it does not end within {_LONGEST_END_S:g} s", "unplug it once"
                )

    def _read(self) -> None:
        """Fill buffers until nothing comes any more after the end was announced."""
        lost: Lost | None = None
        kept_s = time.monotonic()
        try:
            while True:
                ending = self._ending.is_set()  # asked first: what comes during the last wait is not missed
                buffer = self._next_free(may_wait=ending)
                into = self._scratch if buffer is None else buffer
                self._waiting.set()
                size = self._link.read_into(EVENTS, into, _ASKED, _TIMEOUT_S)
                if size == 0:
                    if buffer is not None:
                        self._free.put(buffer)
                    if ending:
                        return
                    continue
                self.bytes_received += size
                now_s = time.monotonic()
                if buffer is None:
                    self.dropped_transfers += 1
                    lost = _more(lost, size, now_s - kept_s)
                else:
                    if lost is not None:
                        lost = Lost(lost.transfers, lost.size, now_s - kept_s)
                    self._full.put((buffer, size, lost))
                    lost, kept_s = None, now_s
        except DeviceError as error:
            self.failure = error
            _log.warning("%s", error)
        finally:
            self._waiting.set()
            if lost is not None:
                self._full.put((self._scratch, 0, lost))
            self._full.put(None)

    def _next_free(self, *, may_wait: bool) -> array[int] | None:
        """Return a buffer of the pool, None if it is empty; the keeper gives buffers back whatever happens."""
        with contextlib.suppress(queue.Empty):
            return self._free.get_nowait()
        if self._still_to_make:
            self._still_to_make -= 1
            return self._new_buffer()
        return self._free.get() if may_wait else None

    def _new_buffer(self) -> array[int]:
        return array("B", bytes(self._transfer_bytes))

    def _keep(self) -> None:
        """Put full buffers into the spool, and give them back."""
        while (item := self._full.get()) is not None:
            buffer, size, lost = item
            if lost is not None:
                self._spool.note_lost(lost)
            if size == 0:
                continue
            self._put_away(memoryview(buffer)[:size])
            self._free.put(buffer)

    def _put_away(self, data: memoryview) -> None:
        """Put bytes into the spool; once it took none, it gets none."""
        if isinstance(self.failure, DataLost):
            self.unkept_transfers += 1
            return
        try:
            self._spool.write(data)
        except OSError as error:
            self.unkept_transfers += 1
            self.failure = DataLost(self._device, "keep the event stream", str(error), "make room on the disk")
            _log.error("%s", self.failure)


def _more(lost: Lost | None, size: int, seconds: float) -> Lost:
    """Return what is lost when one more transfer is."""
    return Lost(1, size, seconds) if lost is None else Lost(lost.transfers + 1, lost.size + size, seconds)
