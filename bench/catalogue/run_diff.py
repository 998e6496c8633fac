"""What differs between two runs, in groups: protocol, station, sensor, window, points; apart, what matters less."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from bench.catalogue.point_diff import facts_of, point_differences, reading_differences
from bench.catalogue.tree_diff import MISSING, Difference, tree_differences, value_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

__all__ = ["Group", "RunDiff", "diff_runs"]

#: Keys of run.yaml that hold settings, by the group in which they are told.
_GROUPS: Final = {"station": "station", "sensor": "sensor", "window": "roi"}
#: Words in a protocol or a station, which change nothing.
_WORDS: Final = ("title", "description")
#: Keys that are told elsewhere, say the same in other words, or come with the format.
_TOLD: Final = {"protocol", *_GROUPS.values(), "seed", "software", "format", "protocol_text"}
#: A setting of one of several measurements: what comes before their number, the number, and what comes after it.
_OF_ONE: Final = re.compile(r"(measurements\[)([^]]*)(\]\..*)")

_Keys = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Group:
    """Differences of one kind."""

    name: str
    settings: bool  #: whether the runs count as different because of them
    differences: tuple[Difference, ...]


@dataclass(frozen=True, slots=True)
class RunDiff:
    """What differs between two runs."""

    left: str
    right: str
    groups: tuple[Group, ...]  #: all, also those without a difference
    remarks: tuple[str, ...] = ()  #: what could not be compared

    @property
    def equal(self) -> bool:
        """Whether no setting differs."""
        return not any(group.settings and group.differences for group in self.groups)

    def lines(self) -> list[str]:
        """Return the differences for people, a line for each, under the name of its group."""
        told = [f"{self.left} | {self.right}"]
        for group in self.groups:
            if group.differences:
                told += ["", group.name if group.settings else f"{group.name} (no difference of the settings)"]
                told += [f"  {line}" for line in _folded(group.differences)]
        same = [group.name for group in self.groups if group.settings and not group.differences]
        end = "the settings are the same" if self.equal else f"the same: {', '.join(same)}" if same else ""
        return [*told, *(["", end] if end else []), *(f"not compared: {remark}" for remark in self.remarks)]

    def to_dict(self) -> dict[str, Any]:
        """Return the differences as plain data, for programs."""
        return {
            "format": "evs-bench-run-diff/1",
            "left": self.left,
            "right": self.right,
            "equal": self.equal,
            "settings": _plain(self.groups, settings=True),
            "apart": _plain(self.groups, settings=False),
            "not_compared": list(self.remarks),
        }


def _folded(differences: Iterable[Difference]) -> list[str]:
    """Return a line for each difference; one that several measurements have alike is one line."""
    numbers: dict[tuple[str, str], list[str]] = {}
    for one in differences:
        values = f"{value_text(one.left)} | {value_text(one.right)}"
        found = _OF_ONE.fullmatch(one.path)
        before, number, after = found.groups() if found else (one.path, "", "")
        numbers.setdefault((before, f"{after}: {values}"), []).append(number)
    return [f"{before}{', '.join(which)}{after}" for (before, after), which in numbers.items()]


def _plain(groups: tuple[Group, ...], *, settings: bool) -> dict[str, list[dict[str, Any]]]:
    return {g.name: [d.to_dict() for d in g.differences] for g in groups if g.settings is settings}


def diff_runs(left: Path, right: Path, *, points: bool = True) -> RunDiff:
    """Return what differs between the runs in the folders `left` and `right`.

    Parameters
    ----------
    left, right
        Run folders.
    points
        Whether to look into the point files, too; damaged ones are left out, and said to be.

    Raises
    ------
    RunError
        If one of them is no run, or none of its points can be read.
    """
    from bench.store import Run

    runs = Run.open(left), Run.open(right)
    one, other = (run.header.everything for run in runs)
    protocol, seeds = _protocol(one, other)
    groups = [Group("protocol", True, protocol)]
    groups += [Group(name, True, tuple(_below(_part(one, key), _part(other, key)))) for name, key in _GROUPS.items()]
    groups.append(Group("seed", True, (*_of_key(one, other, "seed"), *seeds)))
    remarks: tuple[str, ...] = ()
    if points:
        sound = [run.without_damaged() for run in runs]
        remarks = tuple(line for run in sound for line in run.damaged)
        facts = facts_of(sound[0]), facts_of(sound[1])
        groups.append(Group("points", True, tuple(point_differences(*facts))))
        groups.append(Group("readings", False, tuple(reading_differences(*facts))))
    groups.append(Group("software", False, tuple(_of_key(one, other, "software"))))
    groups.append(Group("names and times", False, (*_words(one, other), *_others(one, other))))
    return RunDiff(str(left), str(right), tuple(groups), remarks)


def _protocol(left: _Keys, right: _Keys) -> tuple[tuple[Difference, ...], tuple[Difference, ...]]:
    """Return what differs in the protocol, and where a measurement has a seed that the other run's has not."""
    found = list(_below(_part(left, "protocol"), _part(right, "protocol")))
    seeds = [one for one in found if one.path.endswith(".seed")]
    own = [one for one in seeds if (one.left, one.right) != (left.get("seed"), right.get("seed"))]
    return tuple(one for one in found if one not in seeds), tuple(own)


def _part(run: _Keys, key: str) -> dict[str, Any]:
    """Return a part of run.yaml without its words and without the seed, which is told by itself."""
    part = run.get(key)
    return {k: v for k, v in part.items() if k not in (*_WORDS, "seed")} if isinstance(part, dict) else {}


def _below(left: dict[str, Any], right: dict[str, Any]) -> Iterator[Difference]:
    """Yield differences within one part of run.yaml; where one run has none of it, that alone."""
    if bool(left) != bool(right):
        yield Difference("all of it", "there" if left else MISSING, "there" if right else MISSING)
    else:
        yield from tree_differences(left, right)


def _of_key(left: _Keys, right: _Keys, key: str) -> Iterator[Difference]:
    return tree_differences({key: left.get(key)}, {key: right.get(key)})


def _words(left: _Keys, right: _Keys) -> Iterator[Difference]:
    """Yield where words of the protocol and the station differ."""
    for key in ("protocol", "station"):
        parts = [part if isinstance(part := run.get(key), dict) else {} for run in (left, right)]
        one, other = ({word: part.get(word) for word in _WORDS} for part in parts)
        yield from tree_differences(one, other, key)


def _others(left: _Keys, right: _Keys) -> Iterator[Difference]:
    """Yield differences in the keys of run.yaml that no group has: id, created, title, and what others write."""
    one, other = ({key: value for key, value in run.items() if key not in _TOLD} for run in (left, right))
    return tree_differences(one, other)
