"""A run that is killed and resumed again and again, beside one that is left alone.

Every process is forked from this one, in which all is imported already. After each kill the folder is looked
through: what was called done must still be there, as it was.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench.run import resume, run_protocol
from bench.station import load_station
from bench.store.journal import last_done, read_journal
from bench.store.layout import JOURNAL_FILE, RUN_FILE
from bench.store.run import sha256_of
from benchmarks.soak.places import IN_A_RESUME, PLACES, RANDOM, arm
from protocols import parse_protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

__all__ = ["Kills", "kill_and_resume"]

_KILLS_A_RUN: Final = 5
_BEGINS: Final = "before the rename"
#: Attributes that say when a point was taken, and not what came of it.
_WHEN: Final = frozenset({"started"})
_PROTOCOL: Final = """\
format: evs-bench-protocol/1
title: a night in small
seed: 5
roi: {x: 10, y: 20, width: 8, height: 8}
expect: {dark_light_lux: 0.146}
settings: {long_refractory_period_s: 0.010, imbalanced_thresholds: {on: 0.30, off: 0.25}, bandwidth_hz: 200}
pulses: 6
measurements:
  - name: "on"
    stimulus: {kind: reset_test, polarity: "on", gap_s: 0.04, reset_s: 0.04, test_s: 0.04,
               reset_contrast: {scale: linear, value: 1.2}}
    sweep:
      illuminance_lux: [1, 100]
      contrast: {scale: threshold, linspace: {start: 0.3, stop: 1.4, num: 6}}
  - name: background
    stimulus: {kind: constant, duration_s: 2}
    sweep: {illuminance_lux: [2, 100]}
"""


@dataclass(slots=True)
class Kills:
    """What became of the runs."""

    runs: int = 0
    places: Counter[str] = field(default_factory=Counter)  #: kills, by place
    survived: Counter[str] = field(default_factory=Counter)  #: the process came to its end before the place
    adopted: int = 0  #: points whose file was whole before its line was written
    problems: list[str] = field(default_factory=list)

    @property
    def kills(self) -> int:
        """Number of kills."""
        return sum(self.places.values())


def kill_and_resume(folder: Path, kills: int, seed: int, tell: Callable[[str], None]) -> Kills:
    """Take runs below `folder` and kill them, `kills` times or a few more, evenly at all places; look after each.

    Parameters
    ----------
    folder
        Is made.
    seed
        Of the order and the moments.
    tell
        Called with a line for each run.
    """
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True)
    whole = folder / "whole"
    _require(_child(lambda: _take(whole)) == 0, f"{whole}: the undisturbed run failed")
    wanted = _content(whole)
    found = Kills()
    order = _order(kills, rng)
    while order and not found.problems:
        _one_run(folder / f"run{found.runs}", order, wanted, found, rng)
        found.runs += 1
        tell(f"{found.kills} kills of about {kills}, {found.runs} runs, {len(found.problems)} problems")
    return found


def _require(fine: bool, text: str) -> None:
    if not fine:
        raise RuntimeError(text)


def _order(kills: int, rng: np.random.Generator) -> list[str]:
    """Return the places, one for each kill, mixed; as many of each as it comes out even."""
    names = list(PLACES)
    each = [names[i % len(names)] for i in range(kills)]
    return [each[i] for i in rng.permutation(kills)]


def _one_run(folder: Path, order: list[str], wanted: dict[str, Any], found: Kills, rng: np.random.Generator) -> None:
    done: dict[int, tuple[str | None, str | None]] = {}
    for _ in range(_KILLS_A_RUN):
        begun = (folder / RUN_FILE).exists() and (folder / JOURNAL_FILE).exists()
        if not order:
            break
        place = _next(order, begun)
        killed = _killed(folder, begun, place, rng)
        if killed:
            with contextlib.suppress(ValueError):  # one that only begins a run for others
                order.remove(place)
            found.places[place] += 1
        else:
            found.survived[place] += 1
        done = _looked_through(folder, done, found)
        if not killed:
            break
    if not (folder / JOURNAL_FILE).exists():
        return  # killed before there was a run
    code = _child(lambda: _resume(folder))
    if code:
        found.problems.append(f"{folder}: could not be resumed, exit code {code}")
        return
    _looked_through(folder, done, found)
    found.problems += _at_the_end(folder, wanted)


def _next(order: list[str], begun: bool) -> str:
    """Return the next place that may come now; where none is left that may, one that begins a run."""
    return next((place for place in order if begun or place not in IN_A_RESUME), _BEGINS)


def _killed(folder: Path, begun: bool, place: str, rng: np.random.Generator) -> bool:
    """Take the run, or go on with it, until it is killed at a place; return whether it was."""
    number, after_s = int(rng.integers(1, 9)), float(rng.uniform(0.0, 1.5))

    def work() -> None:
        arm(place, number)
        (_resume if begun else _take)(folder)

    return _child(work, after_s if place == RANDOM else None) == -signal.SIGKILL


def _take(folder: Path) -> None:
    run_protocol(parse_protocol(_PROTOCOL, "soak.yaml"), load_station("simulated"), folder)


def _resume(folder: Path) -> None:
    resume(folder)


def _child(work: Callable[[], None], kill_after_s: float | None = None) -> int:
    """Do work in a process of its own, and return its exit code; minus the signal that killed it."""
    number = os.fork()
    if number == 0:
        _work_and_leave(work)
    if kill_after_s is not None:
        time.sleep(kill_after_s)
        os.kill(number, signal.SIGKILL)  # it is not waited for yet: the number is still its own
    return os.waitstatus_to_exitcode(os.waitpid(number, 0)[1])


def _work_and_leave(work: Callable[[], None]) -> None:
    """Do work and leave the process, whatever happens: nothing of the parent's must be done twice."""
    code = 1
    try:
        work()
        code = 0
    except Exception as error:  # noqa: BLE001 - told, and the exit code says it
        print(f"{type(error).__name__}: {error}", file=sys.stderr, flush=True)
    finally:
        os._exit(code)


def _looked_through(
    folder: Path, before: dict[int, tuple[str | None, str | None]], found: Kills
) -> dict[int, tuple[str | None, str | None]]:
    """Return the points that are done; what was done before must be done still, with the same file, and whole."""
    if not (folder / JOURNAL_FILE).exists():
        return {}
    journal = read_journal(folder / JOURNAL_FILE)
    done = {index: (entry.file, entry.sha256) for index, entry in last_done(journal).items()}
    for index, file in before.items():
        if done.get(index) != file:
            found.problems.append(f"{folder}: point {index} was done as {file}, and is {done.get(index)} now")
    for index, (name, sha256) in done.items():
        if name is None or not (folder / name).exists() or sha256_of(folder / name) != sha256:
            found.problems.append(f"{folder}: point {index} is called done, and {name} is not as it was written")
    return done


def _at_the_end(folder: Path, wanted: dict[str, Any]) -> Iterator[str]:
    """Yield what is wrong with a run that came to its end after all."""
    journal = read_journal(folder / JOURNAL_FILE)
    times = Counter(entry.point for entry in journal if entry.state == "done")
    for index, number in times.items():
        if number != 1:
            yield f"{folder}: point {index} was taken {number} times"
    if journal[-1].state != "run_finished":
        yield f"{folder}: ends with {journal[-1].state}"
    if list((folder / "points").glob("*.part*")):
        yield f"{folder}: half-written files are left"
    there = _content(folder)
    for name in sorted(wanted.keys() | there.keys()):
        if not _same(wanted.get(name), there.get(name)):
            yield f"{folder}: {name} is not that of the undisturbed run"


def _content(folder: Path) -> dict[str, Any]:
    """Return all that a run holds, by file and name in it."""
    import h5py

    content: dict[str, Any] = {}
    for path in sorted((folder / "points").glob("*.h5")):
        with h5py.File(path) as file:

            def keep(name: str, item: Any, file_name: str = path.name) -> None:
                where = f"{file_name}:{name}"
                content.update({f"{where}@{key}": value for key, value in item.attrs.items() if key not in _WHEN})
                if isinstance(item, h5py.Dataset):
                    content[where] = item[()]

            keep("/", file)
            file.visititems(keep)
    return content


def _same(one: Any, other: Any) -> bool:
    with contextlib.suppress(TypeError):
        return bool(np.array_equal(one, other, equal_nan=True))
    return bool(np.array_equal(one, other))
