"""Files of finished cases, of diagnoses, sizes and floors: a line of JSON each, so that a stopped study goes on."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any

from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from benchmarks.planted.cases import Case

__all__ = ["append", "finished", "joined", "read"]


def append(path: Path, record: dict[str, Any]) -> None:
    """Add a finished case, and return when it is on disk."""
    line = json.dumps(record, allow_nan=False) + "\n"
    with path.open("ab") as file:
        if not _ends_whole(path):
            file.write(b"\n")  # what was torn stays a line of its own
        file.write(line.encode())
        file.flush()
        os.fsync(file.fileno())


def read(path: Path) -> list[dict[str, Any]]:
    """Return the finished cases, the last line of each; none where there is no file.

    Lines that were torn when a study was killed are left out.
    """
    if not path.exists():
        return []
    found: dict[str, dict[str, Any]] = {}
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            record = json.loads(line)
        except ValueError:
            continue
        if isinstance(record, dict) and "name" in record:
            found[record["name"]] = record
    return list(found.values())


def finished(path: Path, seed: int, cases: Sequence[Case] | None = None) -> set[str]:
    """Return the names of what is finished; of cases that are named, if they still are what they were.

    Raises
    ------
    InputError
        The file belongs to a study with another seed.
    """
    records = read(path)
    others = {r["study_seed"] for r in records} - {seed}
    if others:
        raise InputError(f"{path}: holds cases of seed {min(others)}, not {seed}; name another place with --results")
    if cases is None:
        return {r["name"] for r in records}
    truths = {case.name: json.loads(json.dumps(case.to_dict())) for case in cases}
    return {r["name"] for r in records if truths.get(r["name"]) == r["truth"]}


def joined(diagnoses: Path, sizes: Path, floors: Path | None = None) -> list[dict[str, Any]]:
    """Return the cases of which both is finished, diagnosis and sizes, with the floor where it was asked for."""
    size_of, floor_of = _by_name(sizes), {} if floors is None else _by_name(floors)
    found = []
    for record in read(diagnoses):
        sized, floor = (_same_case(record, known) for known in (size_of, floor_of))
        if sized is not None:
            one = {**record, "sizes": sized["sizes"], "sizes_revision": sized["revision"]}
            found.append(one if floor is None else {**one, "floor": floor["floor"]})
    return found


def _by_name(path: Path) -> dict[str, dict[str, Any]]:
    return {r["name"]: r for r in read(path)}


def _same_case(record: dict[str, Any], known: dict[str, dict[str, Any]]) -> dict[str, Any] | None:
    other = known.get(record["name"])
    return other if other is not None and other["truth"] == record["truth"] else None


def _ends_whole(path: Path) -> bool:
    size = path.stat().st_size
    if size == 0:
        return True
    with path.open("rb") as file:
        file.seek(size - 1)
        return file.read(1) == b"\n"
