"""Twelve hours of bench time on emulated wires, with a fault every 20 minutes on average."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench.run import run_protocol
from bench.run.progress import NoProgress
from bench.station import load_station, station_from
from bench.store import Run
from drivers.errors import DeviceError
from protocols import parse_protocol
from sim_backend.wire.faults import Fault, FaultPlan
from sim_backend.wire.world import WiredBench

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.run.progress import Status
    from bench.station import Station

__all__ = ["Night", "spend_a_night"]

_HOUR_S: Final = 3600.0
_EVERY_S: Final = 1200.0
_FIRST_REQUESTS: Final = 12  #: the fault befalls one of so many requests of a point
_TIMEOUT_S: Final = 0.5
_SERIAL: Final = (
    Fault.REPLY_LOST, Fault.REPLY_LATE, Fault.REPLY_CUT, Fault.GARBAGE, Fault.ALARM, Fault.REBOOT, Fault.UNPLUGGED,
)  # fmt: skip
_CAMERA: Final = (
    Fault.REPLY_LOST, Fault.REPLY_LATE, Fault.REPLY_CUT, Fault.GARBAGE, Fault.UNPLUGGED, Fault.OVERFLOW,
    Fault.TRIGGERS_MISSED, Fault.TRIGGERS_SWAPPED,
)  # fmt: skip
#: What can befall whom.
KINDS: Final = tuple(
    (name, fault)
    for name, faults in (("led_driver", _SERIAL), ("wheel", _SERIAL), ("camera", _CAMERA))
    for fault in faults
)
#: Points of a minute or so of bench time; every one changes the filter, so that the wheel has something to do.
_PROTOCOL: Final = """\
format: evs-bench-protocol/1
title: a night
seed: 5
roi: {{x: 632, y: 352, width: 16, height: 16}}
expect: {{dark_light_lux: 0.146}}
settings: {{long_refractory_period_s: 0.010, imbalanced_thresholds: {{on: 0.30, off: 0.25}}, bandwidth_hz: 200}}
pulses: 200
policy:
  on_failure: {{retries: 3, wait_s: 5, then: skip}}
  on_bad_point: {{retries: 1, budget: 100, then: keep}}
  reconnect: {{attempts: 5, wait_s: 5}}
  deadline: {{factor: 3, at_least_s: 120}}
measurements:
{measurements}"""
_MEASUREMENT: Final = """\
  - name: "on_{number}"
    stimulus: {{kind: reset_test, polarity: "on", gap_s: 0.1, reset_s: 0.05, test_s: 0.05,
               reset_contrast: {{scale: linear, value: 1.2}}}}
    sweep:
      illuminance_lux: [1, 100]
      nd_od: {{od: 2.0, below_lux: 10}}
      contrast: {{scale: threshold, linspace: {{start: 0.3, stop: 1.4, num: 5}}}}
  - name: "background_{number}"
    stimulus: {{kind: constant, duration_s: 60}}
    sweep:
      illuminance_lux: [1, 100]
      nd_od: {{od: 2.0, below_lux: 10}}
"""
_POINTS_S: Final = 10 * 60.3 + 2 * 60.5 + 12.0  #: that a measurement takes, about


@dataclass(slots=True)
class Night:
    """What became of it."""

    hours: float = 0.0  #: of bench time
    real_s: float = 0.0
    points: int = 0
    done: int = 0
    skipped: int = 0
    taken_again: int = 0
    failures: int = 0
    faults: Counter[str] = field(default_factory=Counter)  #: by instrument and kind
    not_come: tuple[str, ...] = ()  #: that were put in, and that no request ran into
    memory_mib: dict[float, float] = field(default_factory=dict)  #: resident, by hour of bench time
    problems: list[str] = field(default_factory=list)


class _Bringer(NoProgress):
    """Puts faults in as the night goes by: it is told before each point."""

    def __init__(self, world: WiredBench, seed: int, night: Night, tell: Callable[[str], None]) -> None:
        self._world = world
        self._rng = np.random.default_rng(seed)
        self._night = night
        self._tell = tell
        self._begin_s = world.clock.now_ns * 1e-9
        self._due_s = self._gap_s()
        self._left: list[tuple[str, Fault]] = []
        self._hour = 0

    def update(self, status: Status) -> None:
        """Put in what is due by now."""
        now_s = self._world.clock.now_ns * 1e-9 - self._begin_s
        while self._due_s <= now_s:
            self._bring()
            self._due_s += self._gap_s()
        self._night.hours = now_s / _HOUR_S
        if int(now_s / _HOUR_S) > self._hour:
            self._hour = int(now_s / _HOUR_S)
            self._night.memory_mib[self._hour] = _resident_mib()
            self._tell(
                f"{self._hour} h: {status.done} of {status.total} points, {sum(self._night.faults.values())} faults"
            )

    def _gap_s(self) -> float:
        return float(self._rng.exponential(_EVERY_S))

    def _bring(self) -> None:
        """Let the next kind befall the next point; each kind comes once before one comes again."""
        if not self._left:
            self._left = [KINDS[i] for i in self._rng.permutation(len(KINDS))]
        name, fault = self._left.pop()
        at = 0 if name == "wheel" else int(self._rng.integers(0, _FIRST_REQUESTS))
        self._world.faults[name].plan(FaultPlan(fault, at, seconds=2.0 * _TIMEOUT_S))
        self._night.faults[f"{name} {fault}"] += 1


def spend_a_night(folder: Path, hours: float, seed: int, tell: Callable[[str], None]) -> Night:
    """Take a run of so many hours of bench time below `folder`, and say what became of it."""
    night = Night()
    station = _station()
    world = station.world
    if not isinstance(world, WiredBench):
        raise TypeError("station wire has no wires")
    number = max(1, round(hours * _HOUR_S / _POINTS_S))
    protocol = _PROTOCOL.format(measurements="".join(_MEASUREMENT.format(number=n) for n in range(number)))
    begin_s = time.monotonic()
    try:
        result = run_protocol(
            parse_protocol(protocol, "night.yaml"), station, folder, progress=_Bringer(world, seed, night, tell)
        )
        night.done, night.points, night.skipped = result.done, result.total, result.skipped
        if result.stopped:
            night.problems.append("the run did not come to its end")
    except DeviceError as error:
        night.problems.append(f"the run was ended: {' '.join(str(error).split())}")
    night.real_s = time.monotonic() - begin_s
    night.memory_mib[night.hours] = _resident_mib()
    _look_at(Run.open(folder), night)
    if world.level != 0.0:
        night.problems.append(f"the light is at {world.level} when all is over")
    return night


def _station() -> Station:
    """Return the wired station, with time-outs that need less patience."""
    plan: dict[str, Any] = load_station("wire").resolved
    for role in ("light", "wheel"):
        plan["roles"][role]["args"]["timeout_s"] = _TIMEOUT_S
    return station_from(plan, "wire")


def _look_at(run: Run, night: Night) -> None:
    run.verify()
    states = Counter(entry.state for entry in run.journal)
    night.taken_again, night.failures = states["rejected"], states["failed"]
    accounted = {e.point for e in run.journal if e.state in ("done", "skipped")}
    planned = {e.point for e in run.journal if e.state == "planned"}
    if accounted != planned:
        night.problems.append(f"{len(planned - accounted)} points are neither done nor skipped")


def _resident_mib() -> float:
    """Return the resident memory of this process, MiB."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS:")) / 1024.0
