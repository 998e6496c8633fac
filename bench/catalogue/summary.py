"""One run folder read for the catalogue: ``run.yaml`` and the journal, never the points themselves."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from bench.catalogue.counts import count_journal
from bench.catalogue.entry import RunEntry
from bench.store.errors import RunError
from bench.store.header import header_from, use_plain_values
from bench.store.journal import last_done, read_journal
from bench.store.layout import JOURNAL_FILE, POINTS_FOLDER, RUN_FILE

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from bench.store.data import RunHeader
    from bench.store.journal import JournalEntry

__all__ = ["is_run_folder", "one_line", "read_run_file", "roles_text", "summarize"]

#: Words in a protocol, which change nothing of what is measured.
_WORDS: Final = ("title", "description")
#: What :func:`bench.run.runner.new_run_id` puts before the name of the protocol, with a dash behind it.
_MOMENT: Final = re.compile(r"\d{4}-\d\d-\d\dT[\d.-]+Z-(?P<name>.+)")


def is_run_folder(folder: Path) -> bool:
    """Return whether `folder` has the file that makes a folder a run."""
    return (folder / RUN_FILE).is_file()


def summarize(folder: Path) -> RunEntry:
    """Return what the catalogue keeps of `folder`. It never raises: what is wrong stands in `problem`."""
    if not is_run_folder(folder):
        return RunEntry(folder.name, problem=_no_run(folder))
    try:
        header = header_from(read_run_file(folder), RUN_FILE)
    except RunError as error:
        return RunEntry(folder.name, problem=_without(folder, error))
    entry = _from_header(folder.name, header)
    try:
        return replace(entry, **_from_points(folder), bytes=_bytes(folder))
    except (RunError, OSError) as error:
        return replace(entry, problem=_without(folder, error))


def _no_run(folder: Path) -> str:
    inside = sum(is_run_folder(one) for one in folder.iterdir() if one.is_dir()) if _readable(folder) else 0
    if inside:
        return f"no {RUN_FILE}, but {inside} run{'s' * (inside > 1)} in it: list that folder by itself"
    return f"this is no run, it has no {RUN_FILE}"


def _readable(folder: Path) -> bool:
    try:
        next(folder.iterdir(), None)
    except OSError:
        return False
    return True


def _without(folder: Path, error: Exception) -> str:
    """Return an error in one line, without the path of the folder, which stands beside it."""
    return one_line(str(error).replace(f"{folder}/", ""))


def one_line(text: str) -> str:
    """Return `text` in one line of what can be printed: titles and messages may hold anything."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def read_run_file(folder: Path) -> dict[str, Any]:
    """Return the keys of ``run.yaml``, as :func:`bench.store.header.read_yaml` does, by the C library where it is.

    Raises
    ------
    RunError
        If the file cannot be read, is not YAML, or holds no mapping.
    """
    import yaml

    path = folder / RUN_FILE
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), _loader())  # noqa: S506 - a subclass of a safe loader
    except OSError as error:
        raise RunError(f"{path}: {error.strerror or error}") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise RunError(f"{path}: not YAML: {' '.join(str(error).split())}") from error
    if not isinstance(content, dict):
        raise RunError(f"{path}: expected keys and values, found {type(content).__name__}")
    return content


def _loader() -> Any:
    import yaml

    class Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
        """Six times as fast as the loader in Python: a folder may hold a thousand runs."""

    use_plain_values(Loader)
    return Loader


def _from_header(name: str, header: RunHeader) -> RunEntry:
    protocol, station = (_mapping(header.everything.get(key)) for key in ("protocol", "station"))
    return RunEntry(
        folder=name,
        id=one_line(header.id) or name,
        created=one_line(header.created),
        title=one_line(header.title),
        protocol=_protocol_name(header.id, protocol),
        protocol_hash=_hash(protocol),
        station=one_line(str(station.get("name") or "")),
        drivers=roles_text(station),
        sensor=one_line(header.sensor.name),
        serial=_serial(station),
    )


def _mapping(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _protocol_name(run_id: str, protocol: dict[str, Any]) -> str:
    """Return the name of the protocol's file, which is in the id; else its title."""
    found = _MOMENT.fullmatch(run_id)
    return one_line(found["name"] if found else str(protocol.get("title") or ""))


def _hash(protocol: dict[str, Any]) -> str:
    if not protocol:
        return ""
    asked = {key: value for key, value in protocol.items() if key not in _WORDS}
    try:
        return hashlib.sha256(json.dumps(_sorted(asked)).encode()).hexdigest()
    except (TypeError, ValueError, RecursionError):  # what the bench itself never writes
        return ""


def _sorted(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _sorted(value[key]) for key in sorted(value, key=str)}
    return [_sorted(item) for item in value] if isinstance(value, list) else value


def roles_text(station: dict[str, Any]) -> str:
    """Return the drivers of a resolved station by role, in one line; empty for one that keeps only its name."""
    roles = _mapping(station.get("roles"))
    parts = sorted((str(role), str(_mapping(part).get("driver"))) for role, part in roles.items())
    return one_line("; ".join(f"{role}: {driver}" for role, driver in parts))


def _serial(station: dict[str, Any]) -> str:
    camera = _mapping(_mapping(station.get("identities")).get("camera"))
    return one_line(str(camera.get("serial") or ""))


def _from_points(folder: Path) -> dict[str, Any]:
    if not (folder / JOURNAL_FILE).exists():
        number = sum(1 for _ in (folder / POINTS_FOLDER).glob("*.h5"))
        return {"planned": number, "done": number, "state": "finished"}
    journal = read_journal(folder / JOURNAL_FILE)
    counts = count_journal(journal)
    return {
        "planned": counts.planned,
        **counts.outcomes,
        **counts.verdicts,
        "state": counts.state,
        "duration_s": counts.duration_s,
        "problem": _missing(folder, journal),
    }


def _missing(folder: Path, journal: Iterable[JournalEntry]) -> str:
    """Return which files are not there that the journal calls done."""
    done = [str(entry.file) for entry in last_done(journal).values()]
    there = {f"{POINTS_FOLDER}/{file.name}" for file in (folder / POINTS_FOLDER).glob("*.h5")}
    gone = [name for name in done if name not in there]
    more = f" (and {len(gone) - 1} more)" if len(gone) > 1 else ""
    return one_line(f"{gone[0]}{more} is done, but not there") if gone else ""


def _bytes(folder: Path) -> int:
    files = [folder / RUN_FILE, folder / JOURNAL_FILE, *(folder / POINTS_FOLDER).glob("*.h5")]
    return sum(file.stat().st_size for file in files if file.is_file())
