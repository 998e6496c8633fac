"""What the finished cases say together: numbers for the tables and figures of the report."""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

from benchmarks.planted.score import Score, Share, score, share
from benchmarks.planted.sizes import ALIKE

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

__all__ = [
    "Bin",
    "Claim",
    "Tried",
    "claims",
    "confusion",
    "coverage",
    "detection",
    "group_size",
    "is_strange",
    "tried",
]

#: Standard errors from which on an effect is to be found.
SEEN: Final = 5.0
NOTHING: Final = "(nothing)"
UNEXPLAINED: Final = "(unexplained)"
_EDGES: Final = (0.0, 1.5, 5.0, 10.0, 30.0, 100.0, 1000.0, math.inf)


@dataclass(frozen=True, slots=True)
class Tried:
    """A finished case and its score."""

    name: str
    kind: str
    planted: tuple[str, ...]
    size: dict[str, float]
    beyond_mimic: float | None
    reference: bool
    truth_leaves: float | None  #: error of the true model, where it was asked for
    seconds: float
    score: Score

    @property
    def smallest(self) -> float:
        """Size of the smallest effect; 0 where there is none."""
        return min(self.size.values(), default=0.0)


@dataclass(frozen=True, slots=True)
class Claim:
    """What was asked, and what came out."""

    text: str
    asked: str
    found: Share


@dataclass(frozen=True, slots=True)
class Bin:
    """Single effects of about the same size."""

    low: float
    high: float
    middle: float  #: geometric mean of the sizes in it
    found: Share


def tried(records: Iterable[Mapping[str, Any]]) -> list[Tried]:
    """Return the finished cases with their scores, by name."""
    found = [
        Tried(
            name=r["name"],
            kind=r["truth"]["kind"],
            planted=tuple(r["truth"]["model"]["effects"]),
            size={k: float(v) for k, v in r["sizes"]["size"].items()},
            beyond_mimic=r["sizes"]["beyond_mimic"],
            reference=r["truth"]["engine"] == "reference",
            truth_leaves=r.get("floor"),
            seconds=float(r["seconds"]),
            score=score(r["truth"], r["diagnosis"], r.get("floor")),
        )
        for r in records
    ]
    return sorted(found, key=lambda t: t.name)


def claims(cases: Sequence[Tried]) -> list[Claim]:
    """Return what the study was made to show, in the order in which it is told."""
    single = [c for c in cases if c.kind == "single" and c.smallest >= SEEN]
    several = [c for c in cases if c.kind == "several" and c.smallest >= SEEN]
    none = [c for c in cases if c.kind == "none"]
    outside = [c for c in cases if c.kind == "outside" and c.smallest >= SEEN and is_strange(c)]
    explained = [c for c in cases if c.score.verdict == "explained"]
    stepped = [c for c in cases if len(c.score.unseen) > 1]
    intervals = [mark for marks in coverage(cases).values() for mark in marks]
    return [
        Claim(f"one effect of size {SEEN:g} or more is named first, alone or in its tied group", "95 % or more",
              share([c.score.first_right for c in single])),
        Claim("the same, where the reference engine made the data at another time step", "95 % or more",
              share([c.score.first_right for c in single if c.reference])),
        Claim(f"of two or three effects, each of size {SEEN:g} or more, all are named", "85 % or more",
              share([c.score.all_named for c in several])),
        Claim("with nothing missing, nothing is named", "95 % or more", share([not c.score.groups for c in none])),
        Claim("with nothing missing, the verdict is `nothing_missing`", "",
              share([c.score.verdict == "nothing_missing" for c in none])),
        Claim("an effect from outside the catalogue that nothing in it mimics is called unexplained, "
              "and not given a wrong name", "80 % or more",
              share([c.score.unexplained and not c.score.false for c in outside])),
        Claim("the same, whatever it was named: it is called unexplained", "",
              share([c.score.unexplained for c in outside])),
        Claim("where the verdict is `explained`, the last error is within 10 % of the floor", "all",
              share([c.score.at_floor for c in explained])),
        Claim("the error on unseen points falls at every step", "all", share([c.score.falls for c in stepped])),
        Claim("90 % intervals contain the truth, where the effects were named right", "80 to 97 %",
              share(intervals)),
        Claim("of all cases with planted effects of the catalogue, none was given a name too many", "",
              share([not c.score.false for c in cases if c.kind in ("single", "several")])),
    ]  # fmt: skip


def is_strange(case: Tried) -> bool:
    """Return whether no effect of the catalogue mimics what was planted."""
    return case.beyond_mimic is not None and case.beyond_mimic >= ALIKE


def coverage(cases: Sequence[Tried]) -> dict[str, list[bool]]:
    """Return for each fitted number whether its interval contains the truth, in the cases with the right effects."""
    found: dict[str, list[bool]] = {}
    for case in cases:
        if case.kind != "outside" and {g[0] for g in case.score.groups} == set(case.planted):
            for key, mark in case.score.coverage.items():
                found.setdefault(key, []).append(mark)
    return dict(sorted(found.items()))


def detection(cases: Sequence[Tried]) -> list[Bin]:
    """Return how often a single effect is named first, by its size."""
    single = [c for c in cases if c.kind == "single"]
    found = []
    for low, high in pairwise(_EDGES):
        mine = [c for c in single if low <= c.smallest < high]
        if mine:
            middle = math.exp(statistics.fmean(math.log(max(c.smallest, 0.1)) for c in mine))
            found.append(Bin(low, high, middle, share([c.score.first_right for c in mine])))
    return found


def confusion(cases: Sequence[Tried]) -> dict[tuple[str, str], int]:
    """Return how often a planted effect of a size to be seen was first named what; a tied group counts as right."""
    found: dict[tuple[str, str], int] = {}
    for case in cases:
        if case.kind == "single" and case.smallest >= SEEN:
            key = case.planted[0], _named(case)
            found[key] = found.get(key, 0) + 1
    return dict(sorted(found.items()))


def _named(case: Tried) -> str:
    if case.score.first_right:
        return case.planted[0]
    if case.score.groups:
        return case.score.groups[0][0]
    return UNEXPLAINED if case.score.unexplained else NOTHING


def group_size(cases: Sequence[Tried]) -> float:
    """Return the mean number of effects in the groups that named a single effect right; NaN without any."""
    sizes = [len(c.score.groups[0]) for c in cases if c.kind == "single" and c.score.first_right]
    return statistics.fmean(sizes) if sizes else math.nan
