"""Faults on the wires of a whole run: each kind, at request after request of each instrument.

python -m benchmarks.wire_faults                 every fault at 12 requests of a run, and the table of docs/reference
python -m benchmarks.wire_faults --places 0      at every request
python -m benchmarks.wire_faults --only camera   of one instrument

Each verdict is written to a file as it comes; started again, it goes on with what is missing. After a change of a
driver, begin with a new file.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import sys
import tempfile
import time
from collections import defaultdict
from dataclasses import asdict, dataclass, replace
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
    from collections.abc import Callable, Mapping, Sequence

    from bench.station import Station

__all__ = ["FAULTS", "Trial", "Verdict", "pattern_of", "places_of", "plain", "requests_of", "take"]

_REPORT: Final = Path(__file__).resolve().parents[1] / "docs" / "reference" / "wire-faults.md"
_RESULTS: Final = Path("runs") / "wire-faults.jsonl"
_LATE_S: Final = 0.4
_TIMEOUT_S: Final = 0.2
_SERIAL: Final = (
    Fault.REPLY_LOST, Fault.REPLY_LATE, Fault.REPLY_CUT, Fault.GARBAGE, Fault.ALARM, Fault.REBOOT, Fault.UNPLUGGED,
)  # fmt: skip
_CAMERA: Final = (
    Fault.REPLY_LOST, Fault.REPLY_LATE, Fault.REPLY_CUT, Fault.GARBAGE, Fault.UNPLUGGED, Fault.OVERFLOW,
    Fault.TRIGGERS_MISSED, Fault.TRIGGERS_SWAPPED,
)  # fmt: skip
_SOCKET: Final = (
    Fault.REPLY_LOST, Fault.REPLY_LATE, Fault.REPLY_CUT, Fault.GARBAGE, Fault.REBOOT, Fault.UNPLUGGED,
)  # fmt: skip
#: Station (and after a colon the dialect of its generator) and instrument, and what can befall it.
FAULTS: Final = {
    ("wire", "led_driver"): _SERIAL,
    ("wire_rs7", "rs7"): _SERIAL,
    ("wire", "wheel"): _SERIAL,
    ("wire", "camera"): _CAMERA,
    ("wire_generator:keysight", "generator"): _SOCKET,
    ("wire_generator:rigol", "generator"): _SOCKET,
    ("wire_generator:siglent", "generator"): _SOCKET,
    ("wire_generator", "operator"): (Fault.REPLY_LOST,),
}
_PROTOCOL: Final = """
format: evs-bench-protocol/1
title: Two points
seed: 3
roi: {x: 632, y: 352, width: 2, height: 1}
expect: {dark_light_lux: 0.146}
settings:
  long_refractory_period_s: 0.010
  imbalanced_thresholds: {on: 0.30, off: 0.25}
  bandwidth_hz: 200
pulses: 1
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
    seconds: float  #: of real time

    @property
    def bad(self) -> bool:
        """Whether it came out as no run may."""
        return not self.dark or self.damaged > 0 or not (self.finished or self.told)


def take(trial: Trial) -> Verdict:
    """Take the run of two points with a fault, and say how it came out."""
    begin_s = time.monotonic()
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
            world.faults[trial.instrument].requests, round(time.monotonic() - begin_s, 2),
        )  # fmt: skip


def _station(trial: Trial) -> Station:
    """Return the station with the fault, and with time-outs that need no patience."""
    name, _, dialect = trial.station.partition(":")
    plan: dict[str, Any] = load_station(name).resolved
    for role in ("light", "wheel"):
        if role == "light" or "timeout_s" in plan["roles"][role]["args"] or "port" in plan["roles"][role]["args"]:
            plan["roles"][role]["args"]["timeout_s"] = _TIMEOUT_S
    if dialect:
        plan["roles"]["light"]["args"]["dialect"] = dialect
        plan["world"]["args"]["instruments"]["generator"]["dialect"] = dialect
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
    return _sound(Trial(station, instrument, None)).requests


def _sound(trial: Trial) -> Verdict:
    """Return how a run without a fault came out."""
    verdict = take(trial)
    if not verdict.finished or verdict.bad:
        raise RuntimeError(f"{trial.station}: a run without a fault came out as {verdict}")
    return verdict


def places_of(requests: int, places: int) -> list[int]:
    """Return some requests, evenly over the run; 0 places are all of them."""
    if places <= 0 or places >= requests:
        return list(range(requests))
    return [int((i + 0.5) * requests / places) for i in range(places)]


def pattern_of(told: str) -> str:
    """Return a message without what differs from request to request: its numbers, and the bytes that came."""
    text = re.sub(r"""b(['"])(?:(?!\1)[^\\]|\\.)*\1(\.\.\. \(\d+ bytes\))?""", "<bytes>", plain(told))
    text = re.sub(r"\b(?:[0-9a-f]{2} )+[0-9a-f]{2}\b( \.\.\.)?", "<bytes>", text)
    text = re.sub(r"0x[0-9A-Fa-f]+", "0x#", text)
    return re.sub(r"[-+]?\d+(\.\d+)?([eE][-+]?\d+)?", "#", text)


def plain(told: str) -> str:
    """Return a message without what differs from run to run: random bytes, temporary paths and free ports."""
    text = re.sub(r"""(['"]).*[^ -~].*\1""", "<garbage>", told)
    text = re.sub(r"/[^ ']*evs-bench-wire-[0-9a-f]+/", "", text)
    return re.sub(r"127\.0\.0\.1:\d+", "the instrument", text)


def _trials(known: Mapping[str, Verdict], places: int) -> list[Trial]:
    """Return the trials of the instruments whose requests are known."""
    return [
        Trial(station, instrument, fault, at)
        for (station, instrument), faults in FAULTS.items()
        if (sound := known.get(Trial(station, instrument, None).name)) is not None
        for fault in faults
        for at in places_of(sound.requests, places)
    ]


def _known(results: Path) -> dict[str, Verdict]:
    """Return the verdicts of earlier trials; a line that was cut off is taken again."""
    found = {}
    for line in results.read_text(encoding="utf-8").splitlines() if results.exists() else ():
        try:
            entry = json.loads(line)
            found[entry["trial"]] = Verdict(**entry["verdict"])
        except (ValueError, KeyError, TypeError):
            continue
    return found


def main(arguments: Sequence[str]) -> int:
    """Run all trials; return 1 if one left the light on, a damaged point, or no word."""
    parser = argparse.ArgumentParser(prog="benchmarks.wire_faults", description="faults on the wires of a run")
    parser.add_argument("--places", type=int, default=12, help="each fault at so many requests of a run; 0: at all")
    parser.add_argument("--only", default="", help="one instrument or station")
    parser.add_argument("--workers", type=int, default=2, help="trials side by side")
    parser.add_argument("--results", type=Path, default=_RESULTS, help="where verdicts are kept as they come")
    parser.add_argument("--docs", type=Path, default=_REPORT, help="the report")
    asked = parser.parse_args(arguments)
    asked.results.parent.mkdir(parents=True, exist_ok=True)
    known = _known(asked.results)
    wanted = [Trial(*head, None) for head in FAULTS if asked.only in ("", *head)]
    with Workforce(asked.workers).open(lambda _: None) as executor, asked.results.open("a", encoding="utf-8") as file:

        def take_all(function: Callable[[Trial], Verdict], trials: Sequence[Trial]) -> None:
            for index, verdict in executor.map(function, trials, name=lambda t: t.name):
                name = trials[index].name
                known[name] = verdict
                file.write(json.dumps({"trial": name, "verdict": asdict(verdict)}) + "\n")
                file.flush()
                if verdict.bad:
                    print(f"{name}: {verdict}", flush=True)

        take_all(_sound, [trial for trial in wanted if trial.name not in known])
        mine = {(trial.station, trial.instrument) for trial in wanted}
        trials = [
            t for t in _trials(known, asked.places) if (t.station, t.instrument) in mine and t.name not in known
        ]
        random.Random(0).shuffle(trials)  # noqa: S311 - so that what there is after an hour is of all of them
        print(f"{len(known)} runs are known, {len(trials)} to take", flush=True)
        take_all(take, trials)
    asked.docs.write_text(_report(known), encoding="utf-8")
    print(f"{len(known)} runs; the table is in {asked.docs}")
    return int(any(v.bad for v in known.values()))


_HEAD: Final = """# Faults on the wires

Written by `python -m benchmarks.wire_faults`. A run of two points on the stations of emulated wires, with one fault
at one request of one instrument, again and again, so that the fault comes at every stage of a run. *Requests* is how
many the instrument gets in such a run; where there are as many runs, the fault was put at each of them, and where
there are fewer, at some.

- *Went on*: all points were taken; *flagged*: of these, the points' files say that something is missing or odd.
- *Ended*: the run ended with a message that names device, request and answer.
- *Dark*: the light at the end. *Whole*: points that were called done and are whole; *damaged*: those that are not.
- *Slowest*: the longest run, s of real time, with time-outs of 0.2 s, on a busy computer.

| station | instrument | fault | requests | runs | went on | flagged | ended | dark | whole | damaged | slowest |
|---|---|---|---|---|---|---|---|---|---|---|---|
"""


def _report(verdicts: Mapping[str, Verdict]) -> str:
    rows, counted, possible = [], [], 0
    for (station, instrument), faults in FAULTS.items():
        sound = verdicts.get(Trial(station, instrument, None).name)
        for fault in faults if sound else ():
            head = f"{station} {instrument} {fault} "
            mine = [verdict for name, verdict in verdicts.items() if name.startswith(head)]
            possible += sound.requests if sound else 0
            if mine and sound:
                rows.append(_row((station, instrument, fault.value, sound.requests), mine))
                counted += mine
    went_on, ended = sum(v.finished for v in counted), sum(bool(v.told) for v in counted)
    done, damaged = sum(v.done for v in counted), sum(v.damaged for v in counted)
    total = (
        f"{len(counted)} runs with a fault, of {possible} that there are: {went_on} went on, {ended} ended with a "
        f"message. Of {done} points that are called done {damaged} are damaged."
    )
    return f"{_HEAD}{chr(10).join(rows)}\n\n{total}{_left_on(verdicts)}\n\n## Messages\n\n{_messages(verdicts)}\n"


def _left_on(verdicts: Mapping[str, Verdict]) -> str:
    """Return which runs ended with the light on."""
    lit = [
        f"{name.partition(' ')[2]} ({plain(verdict.told)})" for name, verdict in verdicts.items() if not verdict.dark
    ]
    return f" The light was on at the end of {len(lit)}{': ' if lit else ''}{'; '.join(lit)}."


def _row(head: tuple[object, ...], mine: Sequence[Verdict]) -> str:
    cells = (
        *head, len(mine), sum(v.finished for v in mine), sum(v.finished and v.flagged for v in mine),
        sum(bool(v.told) for v in mine), sum(v.dark for v in mine), sum(v.done - v.damaged for v in mine),
        sum(v.damaged for v in mine), f"{max(v.seconds for v in mine):.1f} s",
    )  # fmt: skip
    return f"| {' | '.join(map(str, cells))} |"


def _messages(verdicts: Mapping[str, Verdict]) -> str:
    """Return the messages that ended runs, those that differ in numbers and bytes alone as one."""
    by_pattern: dict[str, list[tuple[str, str]]] = defaultdict(list)
    for name, verdict in verdicts.items():
        if verdict.told:
            by_pattern[pattern_of(verdict.told)].append((name, verdict.told))
    head = (
        f"{len(by_pattern)} messages; those that differ in numbers and bytes alone are one. How often each came, the "
        "first run that it ended (instrument, fault, request), and its text there.\n\n"
    )
    ordered = sorted(by_pattern.values(), key=lambda found: (found[0][0].split()[:2], -len(found)))
    return head + "\n".join(
        f"- {len(found)}, {found[0][0].partition(' ')[2]}: `{plain(found[0][1])}`" for found in ordered
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
