"""Faults on the wires of a whole run: each kind, at request after request of each instrument.

python -m benchmarks.wire_faults               every fault at 12 requests of a run, and the table of docs/reference
python -m benchmarks.wire_faults --places 0    at every request
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench.compute import Workforce
from bench.run import run_protocol
from bench.station import load_station, station_from
from bench.store import Run, RunError
from drivers.errors import DeviceError
from protocols import parse_protocol
from sim_backend.wire.faults import Fault
from sim_backend.wire.world import WiredBench

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.station import Station

__all__ = ["FAULTS", "Trial", "Verdict", "requests_of", "take"]

_REPORT: Final = Path(__file__).resolve().parents[1] / "docs" / "reference" / "wire-faults.md"
_LATE_S: Final = 0.6
_TIMEOUT_S: Final = 0.3
_SERIAL: Final = (
    Fault.REPLY_LOST, Fault.REPLY_LATE, Fault.REPLY_CUT, Fault.GARBAGE, Fault.ALARM, Fault.REBOOT, Fault.UNPLUGGED,
)  # fmt: skip
_CAMERA: Final = (
    Fault.REPLY_LOST, Fault.REPLY_LATE, Fault.REPLY_CUT, Fault.GARBAGE, Fault.UNPLUGGED, Fault.OVERFLOW,
    Fault.TRIGGERS_MISSED, Fault.TRIGGERS_SWAPPED,
)  # fmt: skip
#: Station and instrument, and what can befall it.
FAULTS: Final = {
    ("wire", "led_driver"): _SERIAL,
    ("wire_rs7", "rs7"): _SERIAL,
    ("wire", "wheel"): _SERIAL,
    ("wire", "camera"): _CAMERA,
}
_PROTOCOL: Final = """
format: evs-bench-protocol/1
title: Two points
seed: 3
roi: {x: 632, y: 352, width: 2, height: 2}
expect: {dark_light_lux: 0.146}
settings:
  long_refractory_period_s: 0.010
  imbalanced_thresholds: {on: 0.30, off: 0.25}
  bandwidth_hz: 200
pulses: 2
measurements:
  - name: "on"
    stimulus:
      kind: reset_test
      polarity: on
      gap_s: 0.3
      reset_s: 0.3
      reset_direction: same
      reset_contrast: {scale: linear, value: 1.2}
      test_s: 0.3
    sweep:
      illuminance_lux: [1, 100]
      nd_od: {od: 2.0, below_lux: 2}
      contrast: {scale: threshold, values: [1.3]}
"""


@dataclass(frozen=True, slots=True)
class Trial:
    """One fault at one request of one instrument."""

    station: str
    instrument: str
    fault: Fault | None
    at: int = 0

    @property
    def name(self) -> str:
        """Its name in lists."""
        return f"{self.station} {self.instrument} {self.fault or 'none'} {self.at}"


@dataclass(frozen=True, slots=True)
class Verdict:
    """How a run with a fault came out."""

    finished: bool  #: all points were taken
    done: int  #: points called done
    damaged: int  #: of these, not whole
    dark: bool  #: the light at the end
    told: str  #: the error that ended the run; empty if none did
    flagged: bool  #: whether a point's file says that something was lost or is odd
    requests: int  #: that the instrument got


def take(trial: Trial) -> Verdict:
    """Take the run of two points with a fault, and say how it came out."""
    station = _station(trial)
    world = station.world
    if not isinstance(world, WiredBench):
        raise TypeError(f"station {trial.station} has no wires")
    with tempfile.TemporaryDirectory() as folder:
        told = ""
        try:
            run_protocol(parse_protocol(_PROTOCOL, "two_points.yaml"), station, Path(folder) / "run")
        except DeviceError as error:
            told = " ".join(str(error).split())
        done, damaged, flagged = _points(Path(folder) / "run")
        return Verdict(
            done == 2 and not told, done, damaged, world.level == 0.0, told, flagged,
            world.faults[trial.instrument].requests,
        )  # fmt: skip


def _station(trial: Trial) -> Station:
    """Return the station with the fault, and with time-outs that need no patience."""
    plan: dict[str, Any] = load_station(trial.station).resolved
    for role in ("light", "wheel"):
        plan["roles"][role]["args"]["timeout_s"] = _TIMEOUT_S
    if trial.fault is not None:
        late = {"fault": trial.fault.value, "at": trial.at, "seconds": _LATE_S}
        plan["world"]["args"]["faults"] = {trial.instrument: [late]}
    return station_from(plan, trial.station)


def _points(folder: Path) -> tuple[int, int, bool]:
    """Return how many points are called done, how many of them are not whole, and whether a file flags something."""
    try:
        run = Run.open(folder)
    except RunError:
        return 0, 0, False
    damaged, flagged = 0, False
    for file in run.files:
        one = replace(run, files=(file,))
        try:
            one.verify()
        except RunError:
            damaged += 1
            continue
        flagged |= any(_is_flag(key, value) for point in one.points() for key, value in point.quality.items())
    return len(run.files), damaged, flagged


def _is_flag(key: str, value: object) -> bool:
    return key != "bytes_received" and isinstance(value, (int, float)) and value > 0


def requests_of(station: str, instrument: str) -> int:
    """Return how many requests an instrument gets in a run without a fault."""
    verdict = take(Trial(station, instrument, None))
    if not verdict.finished or not verdict.dark or verdict.damaged:
        raise RuntimeError(f"{station}: a run without a fault came out as {verdict}")
    return verdict.requests


def _places(requests: int, places: int) -> list[int]:
    """Return some requests, evenly over the run."""
    if places <= 0 or places >= requests:
        return list(range(requests))
    return [round((i + 0.5) * requests / places) for i in range(places)]


def main(arguments: Sequence[str]) -> int:
    """Run all trials; return 1 if one left the light on or a damaged point."""
    parser = argparse.ArgumentParser(prog="benchmarks.wire_faults", description="faults on the wires of a run")
    parser.add_argument("--places", type=int, default=12, help="each fault at so many requests of a run; 0: at all")
    parser.add_argument("--workers", type=int, default=2, help="trials side by side")
    parser.add_argument("--docs", type=Path, default=_REPORT, help="the report")
    asked = parser.parse_args(arguments)
    trials = [
        Trial(station, instrument, fault, at)
        for (station, instrument), faults in FAULTS.items()
        for count in [requests_of(station, instrument)]
        for fault in faults
        for at in _places(count, asked.places)
    ]
    verdicts: dict[Trial, Verdict] = {}
    with Workforce(asked.workers).open(lambda _: None) as executor:
        for index, verdict in executor.map(take, trials, name=lambda t: t.name):
            verdicts[trials[index]] = verdict
            if not verdict.dark or verdict.damaged:
                print(f"{trials[index].name}: {verdict}", flush=True)
    asked.docs.write_text(_report(verdicts), encoding="utf-8")
    print(f"{len(verdicts)} runs; the table is in {asked.docs}")
    return int(any(not v.dark or v.damaged for v in verdicts.values()))


_HEAD: Final = """# Faults on the wires

Written by `python -m benchmarks.wire_faults`. A run of two points on the stations `wire` and `wire_rs7`, with one
fault at one request of one instrument, again and again, so that the fault comes at every stage of a run.

- *Went on*: all points were taken; *flagged*: of these, the points' files say that something is missing or odd.
- *Ended*: the run ended with a message that names device, request and answer.
- *Dark*: the light at the end. *Damaged*: points that were called done and are not whole.

| instrument | fault | runs | went on | flagged | ended | dark | damaged |
|---|---|---|---|---|---|---|---|
"""


def _report(verdicts: dict[Trial, Verdict]) -> str:
    rows, told = [], []
    for (station, instrument), faults in FAULTS.items():
        for fault in faults:
            mine = [
                v for t, v in verdicts.items() if (t.station, t.instrument, t.fault) == (station, instrument, fault)
            ]
            cells = (
                instrument, fault.value, len(mine), sum(v.finished for v in mine),
                sum(v.finished and v.flagged for v in mine), sum(bool(v.told) for v in mine),
                sum(v.dark for v in mine), sum(v.damaged for v in mine),
            )  # fmt: skip
            rows.append(f"| {' | '.join(map(str, cells))} |")
            most = Counter(v.told for v in mine if v.told).most_common(1)
            told += [f"- {instrument}, {fault.value}: `{text}`" for text, _ in most]
    return _HEAD + "\n".join(rows) + "\n\nThe most frequent message of each:\n\n" + "\n".join(told) + "\n"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
