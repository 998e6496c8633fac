"""Running a protocol, and running one once more from what its run folder says."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from bench.run.policies import Conduct
from bench.run.runner import RunResult, Task, take_run
from bench.store.errors import RunError
from bench.store.header import read_header
from bench.store.layout import RUN_FILE
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.compute import Workforce
    from bench.run.progress import Progress
    from bench.run.stop import StopFlag
    from bench.station import Station
    from bench.store.data import RunHeader
    from protocols import LoadedProtocol
    from protocols.schema import Protocol

__all__ = ["conduct_of", "read_task", "rerun", "run_protocol"]


def run_protocol(
    loaded: LoadedProtocol,
    station: Station,
    out: Path | None = None,
    *,
    seed: int | None = None,
    progress: Progress | None = None,
    stop: StopFlag | None = None,
    operator: Callable[[str], None] | None = None,
    workforce: Workforce | None = None,
) -> RunResult:
    """Take all points of the protocol `loaded` on `station`, and leave a run folder.

    Parameters
    ----------
    out
        The run folder to make; default is ``runs/ID``. It must not exist.
    seed
        Seed of a simulated run, in place of all seeds of the protocol, also those of single measurements.
    progress, stop, operator, workforce
        See :func:`~bench.run.runner.take_run`, also for what is raised.
    """
    protocol = loaded.protocol if seed is None else _reseeded(loaded.protocol, seed)
    task = _task(protocol, Path(loaded.source).stem, loaded.text)
    return take_run(task, station, out, progress=progress, stop=stop, operator=operator, workforce=workforce)


def _reseeded(protocol: Protocol, seed: int) -> Protocol:
    measurements = tuple(m.model_copy(update={"seed": None}) for m in protocol.measurements)
    return protocol.model_copy(update={"seed": seed, "measurements": measurements})


def _task(protocol: Protocol, name: str, text: str) -> Task:
    return Task(
        name=name,
        title=protocol.title,
        points=protocol.expand(),
        protocol=protocol.resolved(),
        protocol_text=text,
        seed=protocol.seed,
        conduct=conduct_of(protocol),
        curves=protocol.refined_curves(),
    )


def conduct_of(protocol: Protocol) -> Conduct:
    """Return what a protocol says of how its run is taken."""
    return Conduct(protocol.policy, protocol.suspend, protocol.believed().dark_light_lux)


def rerun(
    folder: Path,
    out: Path | None = None,
    *,
    station: Station | None = None,
    progress: Progress | None = None,
    stop: StopFlag | None = None,
    operator: Callable[[str], None] | None = None,
    workforce: Workforce | None = None,
) -> RunResult:
    """Take the run in `folder` once more, from the protocol, the seed and the station that are written in it.

    On a simulated station the events are the same, one by one.

    Parameters
    ----------
    station
        The station, where the run keeps only its name.

    Raises
    ------
    RunError
        If the run does not say how it was taken, as one that was imported.
    InputError
        If it was taken with effects of a user's own files, and these are not loaded, or are others; if it keeps only
        the name of its station, and that is not given, or another one is.
    """
    header, again, station = read_task(folder, station)
    name = header.id.partition("Z-")[2] or header.id
    task = _task(again, name, str(header.everything.get("protocol_text", "")))
    return take_run(
        task,
        station,
        out,
        progress=progress,
        stop=stop,
        operator=operator,
        workforce=workforce,
    )


def read_task(folder: Path, station: Station | None = None) -> tuple[RunHeader, Protocol, Station]:
    """Return what ``run.yaml`` in `folder` says, with the protocol and the station that are written in it.

    Parameters
    ----------
    station
        The station, where only its name is written there.

    Raises
    ------
    RunError
        If the run does not say how it was taken.
    InputError
        If it was taken with effects of a user's own files, and these are not loaded, or are others; if only the name
        of its station is written, and that is not given, or another one is.
    """
    from bench.models.effect_sources import require_sources
    from protocols.schema import Protocol

    where = folder / RUN_FILE
    header = read_header(where)
    protocol, written = (_part(header.everything, key, where) for key in ("protocol", "station"))
    try:
        again = Protocol.model_validate(protocol)
    except ValidationError as error:
        raise RunError(f"{where}: the protocol in it is none that this version reads: {_first(error)}") from error
    require_sources(_effects_of(header.everything), where)
    return header, again, _station(written, station, where)


def _station(written: dict[str, Any], given: Station | None, where: Path) -> Station:
    """Return the station of a run: as it is written, or the one that is given, if it has the same name."""
    from bench.station import station_from

    if given is None:
        return station_from(written, str(where))
    if written.get("name") != given.name:
        raise InputError(f"{where}: it was taken on station {written.get('name')}, not on {given.name}")
    return given


def _part(everything: dict[str, Any], key: str, where: Path) -> dict[str, Any]:
    part = everything.get(key)
    if not isinstance(part, dict) or not part:
        raise RunError(f"{where}: no {key} is written in it, so it cannot be taken again")
    return part


def _effects_of(everything: dict[str, Any]) -> object:
    """Return what the run says of effects that are not built in."""
    software = everything.get("software")
    return software.get("effects") if isinstance(software, dict) else None


def _first(error: ValidationError) -> str:
    first = error.errors()[0]
    return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
