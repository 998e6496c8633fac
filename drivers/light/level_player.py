"""Edges of light at their times, played by the host: one function, on the clock of the station or in its own process.

A source that is timed by the host answers each level when the light has settled, and the next level is not written
before. In the process of the station other threads hold up an edge by tens of milliseconds as soon as they compute;
:func:`play_in_process` therefore hands the open port to a process that does nothing else.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import select
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final, Protocol

import drivers
from drivers import errors
from drivers.errors import DeviceError
from drivers.light.rs7_answers import Step, ask, step_to
from drivers.light.rs7_errors import Complaint

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers.interfaces import Clock
    from drivers.transport.link import Link

__all__ = ["Played", "PlayerClock", "Schedule", "StationTime", "play_in_process", "play_levels"]

_MODULE: Final = "drivers.light.level_player_process"
_START_S: Final = 20.0  # for the process to come up on a busy computer
_STOP_S: Final = 3.0
_MOST_COMPLAINTS: Final = 1 << 20
_SHOWN: Final = 300


@dataclass(frozen=True, slots=True)
class Schedule:
    """What is to be played."""

    t_s: tuple[float, ...]  #: ascending from 0
    level: tuple[float, ...]
    duration_s: float
    already_at: float | None  #: the level that the light is at, if it is known: no edge is needed to get there
    timeout_s: float  #: for one answer, s of real time


@dataclass(frozen=True, slots=True)
class Played:
    """What was played: the steps, in seconds since the waveform began."""

    steps: tuple[Step, ...]
    traffic: tuple[tuple[float, str, str], ...] = ()  #: of another process: time, sent or received, bytes


class PlayerClock(Protocol):
    """What the player needs of a clock."""

    def now_s(self) -> float:
        """Return the time, s."""

    def wait_until(self, time_s: float) -> None:
        """Return at `time_s`, or at once if that is over."""


class StationTime:
    """The clock of the station, for a player.

    Parameters
    ----------
    clock
        That clock.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock

    def now_s(self) -> float:
        """Return the time, s."""
        return self._clock.now()

    def wait_until(self, time_s: float) -> None:
        """Return at `time_s`, or at once if that is over."""
        left_s = time_s - self._clock.now()
        if left_s > 0.0:
            self._clock.sleep(left_s)


def play_levels(link: Link, device: str, schedule: Schedule, clock: PlayerClock) -> Played:
    """Write each level at its time, or as soon as the light has settled at the one before, and wait for the end.

    Whatever ends the waveform before its end, the light is told to go dark.

    Raises
    ------
    DeviceError
        A level was refused, or was not answered.
    """
    begin_s = clock.now_s()

    def now() -> float:
        return clock.now_s() - begin_s

    steps: list[Step] = []
    try:
        for i, (t_s, level) in enumerate(zip(schedule.t_s, schedule.level, strict=True)):
            clock.wait_until(begin_s + t_s)
            if i == 0 and level == schedule.already_at:
                at_s = now()
                steps.append(Step(at_s, at_s, at_s))
                continue
            steps.append(step_to(link, device, level, now, schedule.timeout_s))
        clock.wait_until(begin_s + schedule.duration_s)
    except BaseException:
        with contextlib.suppress(DeviceError):
            ask(link, device, "OUT 0", "ok", now, schedule.timeout_s)
        raise
    return Played(tuple(steps))


def play_in_process(fd: int, device: str, schedule: Schedule) -> Played:
    """Let a process of its own play `schedule` on the open port `fd`, and return when it is over (POSIX only).

    Nobody else may use the port meanwhile. If this process dies, the other one makes the light dark.

    Raises
    ------
    DeviceError
        It was not played to the end; the light was told to go dark.
    """
    order = json.dumps({"fd": fd, "device": device, "schedule": dataclasses.asdict(schedule)})
    limit_s = _START_S + schedule.duration_s + 3.0 * schedule.timeout_s * (1 + len(schedule.t_s))
    with tempfile.TemporaryFile() as complaints, _process(fd, complaints) as process:
        said = _conversation(process, order + "\n", limit_s)
        complaints.seek(0)
        complained = complaints.read(_MOST_COMPLAINTS).decode("utf-8", "replace").strip()
    if said is None:
        raise _failed(device, f"it did not end within {limit_s:g} s")
    return _result(device, said, complained)


@contextlib.contextmanager
def _process(fd: int, complaints: IO[bytes]) -> Iterator[subprocess.Popen[bytes]]:
    """Start the player; whatever happens, it has ended afterwards."""
    root = str(Path(drivers.__file__).parent.parent)
    process = subprocess.Popen(  # noqa: S603 - our own module, with our own interpreter
        [sys.executable, "-P", "-m", _MODULE],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=complaints,
        pass_fds=(fd,),
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH", ""))))},
        start_new_session=True,  # Ctrl-C is for the station, which then ends the player in good order
    )
    try:
        yield process
    finally:
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()  # the end of its input tells the player to stop
        try:
            process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _conversation(process: subprocess.Popen[bytes], order: str, limit_s: float) -> bytes | None:
    """Give the order, and return what the player said until it ended; None if it did not end in time."""
    if process.stdin is None or process.stdout is None:
        return None
    with contextlib.suppress(OSError):  # it is dead already: it said why
        process.stdin.write(order.encode("utf-8"))
        process.stdin.flush()
    said, deadline = bytearray(), time.monotonic() + limit_s
    while True:
        ready, _, _ = select.select([process.stdout], [], [], max(deadline - time.monotonic(), 0.0))
        if not ready:
            return None
        data = os.read(process.stdout.fileno(), 65536)
        if not data:
            return bytes(said)
        said += data


def _result(device: str, said: bytes, complained: str) -> Played:
    """Return what was played, or raise what went wrong there."""
    try:
        result = json.loads(said)
        if "error" in result:
            raise _error(device, **result["error"])
        steps = tuple(
            Step(**{**step, "alarms": tuple(Complaint(**alarm) for alarm in step["alarms"])})
            for step in result["steps"]
        )
        return Played(steps, tuple((float(t_s), str(what), str(data)) for t_s, what, data in result["traffic"]))
    except (ValueError, TypeError, KeyError) as error:
        raise _failed(device, complained[-_SHOWN:] or f"it said {said[:_SHOWN]!r}") from error


def _error(device: str, kind: str, asked: str, answered: str, advice: str) -> DeviceError:
    """Return the error that the player met."""
    found = getattr(errors, kind, DeviceError)
    plain = isinstance(found, type) and issubclass(found, DeviceError) and found is not errors.OutOfRange
    return (found if plain else DeviceError)(device, asked, answered, advice)


def _failed(device: str, why: str) -> DeviceError:
    return DeviceError(device, "play a waveform in a process of its own", why, "try player: inline")
