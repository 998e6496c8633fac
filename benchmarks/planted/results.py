"""The file of finished cases: one line of JSON each, so that a study that was stopped goes on where it was."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any

from benchmarks.planted.sizes import Sizes
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from benchmarks.planted.cases import Case

__all__ = ["append", "finished", "known_sizes", "read"]


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


def finished(path: Path, seed: int) -> set[str]:
    """Return the names of the finished cases.

    Raises
    ------
    InputError
        The file belongs to a study with another seed.
    """
    records = read(path)
    others = {r["study_seed"] for r in records} - {seed}
    if others:
        raise InputError(f"{path}: holds cases of seed {min(others)}, not {seed}; name another file with --results")
    return {r["name"] for r in records}


def known_sizes(path: Path, cases: Sequence[Case]) -> dict[str, Sizes]:
    """Return the sizes that are in a file, by name, of those cases that are still what they were."""
    truths = {case.name: json.loads(json.dumps(case.to_dict())) for case in cases}
    return {r["name"]: Sizes(**r["sizes"]) for r in read(path) if truths.get(r["name"]) == r["truth"]}


def _ends_whole(path: Path) -> bool:
    size = path.stat().st_size
    if size == 0:
        return True
    with path.open("rb") as file:
        file.seek(size - 1)
        return file.read(1) == b"\n"
