"""The answers of pixels in the points of a curve that are done: what its next contrasts are decided by."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.store.journal import last_done, read_journal
from bench.store.layout import JOURNAL_FILE

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from bench.analysis.grouping import Entry
    from protocols.points import Roi

__all__ = ["Answers"]


class Answers:
    """The answers in the points of one curve; a file is read once.

    Parameters
    ----------
    folder
        The run folder.
    roi
        The run's window of pixels.
    """

    def __init__(self, folder: Path, roi: Roi) -> None:
        self._folder = folder
        self._roi = roi
        self._read: dict[str, list[Entry]] = {}

    def responses(self, points: Iterable[int]) -> list[list[Entry]]:
        """Return the answers of each response of the curve, over those of `points` that are done and not bad.

        A curve of square waves has two: to the steps up, and to those down.

        Raises
        ------
        RunError
            If a file of them cannot be read.
        """
        wanted = set(points)
        done = last_done(read_journal(self._folder / JOURNAL_FILE))
        responses: dict[str, list[Entry]] = {}
        for index, line in done.items():
            if index in wanted and line.file is not None and line.everything.get("verdict") != "red":
                for entry in self._entries(line.file):
                    responses.setdefault(entry.tally.test.polarity, []).append(entry)
        return [entries for _, entries in sorted(responses.items())]

    def _entries(self, file: str) -> list[Entry]:
        if file not in self._read:
            self._read[file] = _entries_of(self._folder / file, self._roi)
        return self._read[file]


def _entries_of(path: Path, roi: Roi) -> list[Entry]:
    from bench.analysis.compact import compact
    from bench.analysis.grouping import Entry
    from bench.analysis.tally import tally_point
    from bench.store.reader import read_point

    point = read_point(path, roi)
    tally = tally_point(point)
    return [Entry.of(point, tally.active, compact(group, square=False)) for group in tally.groups]
