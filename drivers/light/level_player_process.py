"""The process that plays levels on a port that it was handed: `python -m drivers.light.level_player_process`.

It reads one line of JSON (which descriptor, which schedule) and writes one line of JSON (when the levels came, and
the bytes that went over the port; or what went wrong). If its input ends before the waveform does, its parent is gone
or wants no more: it makes the light dark and ends. It imports little and does nothing else, so that nothing holds up
an edge: it sleeps until shortly before one, and then watches the clock.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import select
import sys
import time
from dataclasses import asdict
from typing import Any, Final

from drivers.errors import DeviceError, WrongState
from drivers.light.level_player import Schedule, play_levels
from drivers.transport.link import Link

__all__ = ["DescriptorPort", "SpinningTime", "main"]

_CHUNK: Final = 65536
_WRITE_TIMEOUT_S: Final = 5.0
_SPIN_S: Final = 2e-3  # a sleep ends up to a millisecond or two late


class DescriptorPort:
    """An open port, by its file descriptor; it is closed by whoever opened it.

    Parameters
    ----------
    fd
        The descriptor.
    """

    def __init__(self, fd: int) -> None:
        self.path = f"descriptor {fd}"
        self.traffic: list[tuple[float, str, str]] = []  #: time (monotonic), "sent" or "received", bytes as Latin-1
        self._fd = fd

    def open(self) -> None:
        """Do nothing: it is open."""

    def close(self) -> None:
        """Do nothing: it is not ours to close."""

    def write(self, data: bytes) -> None:
        """Write all of `data`."""
        self.traffic.append((time.monotonic(), "sent", data.decode("latin-1")))
        while data:
            _, ready, _ = select.select([], [self._fd], [], _WRITE_TIMEOUT_S)
            if not ready:
                raise TimeoutError(f"nothing could be written for {_WRITE_TIMEOUT_S:g} s")
            data = data[os.write(self._fd, data) :]

    def discard(self) -> bool:
        """Return False: what waits can be read."""
        return False

    def read(self, timeout_s: float) -> bytes:
        """Return what has come, at least one byte, or nothing after `timeout_s`."""
        ready, _, _ = select.select([self._fd], [], [], max(timeout_s, 0.0))
        if not ready:
            return b""
        data = os.read(self._fd, _CHUNK)
        if not data:
            raise ConnectionResetError(f"{self.path} has no other end")
        self.traffic.append((time.monotonic(), "received", data.decode("latin-1")))
        return data


class SpinningTime:
    """The monotonic clock, waited for with microseconds: a sleep, then a look at the clock over and over.

    Parameters
    ----------
    order_fd
        Where the order came from; when that ends, waiting ends with an error. None: waiting goes on.
    device
        Name of the device, for the message.
    """

    def __init__(self, order_fd: int | None, device: str) -> None:
        self._order_fds = [] if order_fd is None else [order_fd]
        self._device = device

    def now_s(self) -> float:
        """Return the time, s."""
        return time.monotonic()

    def wait_until(self, time_s: float) -> None:
        """Return at `time_s`, or at once if that is over.

        Raises
        ------
        WrongState
            Who gave the order is gone or wants no more.
        """
        while (left_s := time_s - time.monotonic() - _SPIN_S) > 0.0:
            ended, _, _ = select.select(self._order_fds, [], [], left_s)
            if ended:
                raise WrongState(self._device, "play a waveform", "who asked for it is gone or wants no more")
        while time.monotonic() < time_s:
            pass


def _go_first() -> None:
    """Go before other processes, where the system lets us: on a busy computer they hold up edges, too."""
    with contextlib.suppress(AttributeError, OSError):  # not on this system; not without the right to
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))


def main() -> int:
    """Play what the line on the standard input says; return the exit code."""
    order: dict[str, Any] = json.loads(sys.stdin.readline())
    device = order["device"]
    schedule = Schedule(**order["schedule"])
    port = DescriptorPort(order["fd"])
    gc.disable()  # a collection takes milliseconds, and there is nothing to collect
    _go_first()
    try:
        played = play_levels(Link(port, device, schedule.timeout_s), device, schedule, SpinningTime(0, device))
        result: dict[str, Any] = {"steps": [asdict(step) for step in played.steps], "traffic": port.traffic}
    except DeviceError as error:
        told = {"asked": error.asked, "answered": error.answered, "advice": error.advice}
        result = {"error": {"kind": type(error).__name__, **told}}
    sys.stdout.write(json.dumps(result) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
