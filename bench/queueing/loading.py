"""Reading a queue file and all that it names; and a queue as it was asked for, from its own folder."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from difflib import SequenceMatcher, get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench.queueing.plan import MOST_RUNS, plan_runs
from bench.queueing.schema import QueueFile
from protocols import library, load_protocol, parse_protocol
from protocols.errors import InputError, Problem
from protocols.files import parse_model, read_text
from protocols.yaml_strict import read_yaml

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from bench.queueing.plan import QueuedRun
    from bench.station import Station
    from protocols import LoadedProtocol
    from protocols.yaml_strict import Node

__all__ = ["LoadedQueue", "StationSource", "difference_problems", "load_queue", "restored_queue"]

_MOST_DIFFERENCES: Final = 5


@dataclass(frozen=True, slots=True)
class StationSource:
    """Where a station of a queue comes from."""

    place: str  #: name of a shipped one, or absolute path
    text: str | None  #: of its file; None for a shipped one

    def load(self) -> Station:
        """Return the station; nothing is connected."""
        from bench.station import load_station

        return load_station(self.place)


@dataclass(frozen=True, slots=True)
class LoadedQueue:
    """A queue with everything that it names."""

    file: QueueFile
    text: str  #: as it was written
    source: str  #: path of the file
    station: str  #: station of the runs whose entry names none
    protocols: Mapping[str, LoadedProtocol]  #: by the name in the file
    stations: Mapping[str, StationSource]  #: by the name in the file
    runs: tuple[QueuedRun, ...]

    @property
    def title(self) -> str:
        """What people call it."""
        return self.file.title or Path(self.source).stem

    def to_dict(self) -> dict[str, Any]:
        """Return what :func:`restored_queue` needs, as plain data."""
        return {
            "queue": self.text,
            "source": self.source,
            "station": self.station,
            "protocols": {name: {"source": p.source, "text": p.text} for name, p in self.protocols.items()},
            "stations": {name: {"place": s.place, "text": s.text} for name, s in self.stations.items()},
        }


def load_queue(path: Path, station: str = "simulated") -> LoadedQueue:
    """Return the queue in the file `path`; nothing is connected.

    Parameters
    ----------
    path
        A queue file. What it names is looked for beside it.
    station
        A shipped station, or a path: for the entries that name none.

    Raises
    ------
    InputError
        With everything that is wrong in it, or in a protocol or station that it names.
    """
    text, source = read_text(path), str(path)
    file = parse_model(text, QueueFile, source)
    loading = _Loading(file, read_yaml(text, source), source, path.parent)
    protocols, stations = loading.named()
    if _leaves_a_station_open(file):
        stations = {**stations, station: _station_source(station, Path())}
    return _planned(LoadedQueue(file, text, source, station, protocols, stations, ()))


def _leaves_a_station_open(file: QueueFile) -> bool:
    """Return whether a run of the queue is left to the station of the whole queue."""
    if file.reference is not None and file.reference.station is None:
        return True
    return any(entry.station is None for entry in file.entries)


def _planned(queue: LoadedQueue) -> LoadedQueue:
    runs = plan_runs(queue.file, queue.protocols, queue.station)
    if len(runs) > MOST_RUNS:
        raise InputError(Problem(f"{len(runs)} runs in one queue, at most {MOST_RUNS} are allowed", queue.source))
    return replace(queue, runs=runs)


def restored_queue(data: Mapping[str, Any]) -> LoadedQueue:
    """Return the queue that :meth:`LoadedQueue.to_dict` described, as it was asked for.

    Raises
    ------
    InputError
        If a station file has changed since.
    """
    file = parse_model(data["queue"], QueueFile, data["source"])
    protocols = {name: parse_protocol(p["text"], p["source"]) for name, p in data["protocols"].items()}
    stations = {name: StationSource(s["place"], s["text"]) for name, s in data["stations"].items()}
    problems = [
        problem
        for one in stations.values()
        if one.text is not None
        for problem in difference_problems(one.text, read_text(one.place), one.place)
    ]
    if problems:
        raise InputError(*problems)
    return _planned(LoadedQueue(file, data["queue"], data["source"], data["station"], protocols, stations, ()))


def difference_problems(then: str, now: str, source: str) -> list[Problem]:
    """Return where a file differs from what it was when the queue was begun, the first few lines of it."""
    before, after = then.splitlines(), now.splitlines()
    matcher = SequenceMatcher(None, before, after, autojunk=False)
    found = [
        Problem(_changed(before[a:b], after[c:d]), source, min(c + 1, max(len(after), 1)), 1)
        for kind, a, b, c, d in matcher.get_opcodes()
        if kind != "equal"
    ]
    if len(found) > _MOST_DIFFERENCES:
        more = Problem(f"and {len(found) - _MOST_DIFFERENCES} more places differ", source)
        return [*found[:_MOST_DIFFERENCES], more]
    return found


def _changed(before: list[str], after: list[str]) -> str:
    return f"is {_quoted(after)}, but was {_quoted(before)} when the queue was begun"


def _quoted(lines: list[str]) -> str:
    text = re.sub(r"\s+", " ", " / ".join(lines)).strip()
    return repr(text if len(text) <= 80 else text[:77] + "...") if lines else "not there"


class _Loading:
    """Looks up what a queue file names; collects what is wrong."""

    def __init__(self, file: QueueFile, document: Node, source: str, folder: Path) -> None:
        self._file = file
        self._document = document
        self._source = source
        self._folder = folder
        self._problems: list[Problem] = []

    def named(self) -> tuple[dict[str, LoadedProtocol], dict[str, StationSource]]:
        protocols: dict[str, LoadedProtocol] = {}
        stations: dict[str, StationSource] = {}
        for path, protocol, station in self._parts():
            if protocol not in protocols:
                found = self._protocol(path, protocol)
                protocols.update({} if found is None else {protocol: found})
            if station is not None and station not in stations:
                try:
                    stations[station] = _station_source(station, self._folder)
                except InputError as error:
                    self._note((*path, "station"), error)
        if self._problems:
            raise InputError(*self._problems)
        return protocols, stations

    def _parts(self) -> Iterator[tuple[tuple[str | int, ...], str, str | None]]:
        """Yield the place, the protocol and the station of all that is to be run."""
        if self._file.reference is not None:
            yield ("reference",), self._file.reference.protocol, self._file.reference.station
        for number, entry in enumerate(self._file.entries):
            yield ("entries", number), entry.protocol, entry.station

    def _protocol(self, path: tuple[str | int, ...], name: str) -> LoadedProtocol | None:
        place = name if name in library.names() else str(self._folder / name)
        try:
            if place != name and not Path(place).exists():
                raise InputError(_no_protocol(name))
            return load_protocol(place)
        except InputError as error:
            self._note((*path, "protocol"), error)
            return None

    def _note(self, path: tuple[str | int, ...], error: InputError) -> None:
        """Note what is wrong with something that the queue names: at its own place, or where it is named."""
        node = self._document
        for part in path:
            node = node.children[part]
        for problem in error.problems:
            if not problem.file:
                problem = Problem(problem.message, self._source, node.line, node.column)
            self._problems.append(problem)


def _no_protocol(name: str) -> str:
    close = get_close_matches(name, library.names(), n=1)
    hint = f"did you mean {close[0]!r}?" if close else "evs-bench protocols lists the ready-made ones"
    return f"there is no protocol {name!r}: neither a file beside the queue file nor a ready-made one; {hint}"


def _station_source(name: str, folder: Path) -> StationSource:
    """Return where the station `name` comes from; it is loaded once, so that what is wrong in it is told."""
    from bench.station import load_station, stations

    if name in stations():
        return StationSource(name, None)
    path = (folder / name).absolute()
    load_station(path)
    return StationSource(str(path), read_text(path))
