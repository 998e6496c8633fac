"""What the finished cases say together: numbers for the tables and figures of the report."""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from benchmarks.planted.score import Score, Share, score, share
from benchmarks.planted.sizes import ALIKE

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

__all__ = [
    "Bin",
    "Claim",
    "Fall",
    "Tried",
    "claims",
    "confusion",
    "coverage",
    "detection",
    "falls",
    "group_size",
    "is_strange",
    "tried",
]

#: Standard errors from which on an effect is to be found.
SEEN: Final = 5.0
#: A diagnosis that took so long or less is quick, s.
QUICK_S: Final = 30.0
#: Kinds of cases in which the diagnosis knows of each planted effect.
KNOWN: Final = ("single", "several")
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
    found: Share
    least: float | None = None  #: smallest share that was asked for; None where nothing was
    most: float = 1.0  #: largest

    @property
    def met(self) -> bool | None:
        """Whether the share itself is what was asked for; None where nothing was asked, or nothing tried."""
        if self.least is None or self.found.n == 0:
            return None
        return self.least <= self.found.k / self.found.n <= self.most

    @property
    def asked(self) -> str:
        """What was asked, for people; empty where nothing was."""
        if self.least is None:
            return ""
        if self.most < 1.0:
            return f"{100 * self.least:.0f} to {100 * self.most:.0f} %"
        return "all" if self.least == 1.0 else f"{100 * self.least:.0f} % or more"


@dataclass(frozen=True, slots=True)
class Bin:
    """Single effects of about the same size."""

    low: float
    high: float
    middle: float  #: geometric mean of the sizes in it
    found: Share


@dataclass(frozen=True, slots=True)
class Fall:
    """Errors of some cases before anything was added and at the end: (25, 50, 75) % quartiles."""

    kind: str
    count: int
    before: tuple[float, ...]
    after: tuple[float, ...]
    unseen_before: tuple[float, ...]  #: on points that the fit did not see
    unseen_after: tuple[float, ...]


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
    return [
        Claim(f"one effect of size {SEEN:g} or more is named first, alone or in its tied group",
              share([c.score.first_right for c in single]), 0.95),
        Claim("the same, where the reference engine made the data at another time step",
              share([c.score.first_right for c in single if c.reference]), 0.95),
        Claim(f"of two or three effects, each of size {SEEN:g} or more, all are named",
              share([c.score.all_named for c in several]), 0.85),
        Claim("with nothing missing, nothing is named", share([not c.score.groups for c in none]), 0.95),
        Claim("with nothing missing, the verdict is `nothing_missing`",
              share([c.score.verdict == "nothing_missing" for c in none])),
        Claim("an effect from outside the catalogue that nothing in it mimics is called unexplained, "
              "and not given a wrong name",
              share([c.score.unexplained and not c.score.false for c in outside]), 0.80),
        Claim("the same, whatever it was named: it is called unexplained",
              share([c.score.unexplained for c in outside])),
        Claim("where the verdict is `explained`, the last error is within 10 % of the floor",
              share([c.score.at_floor for c in explained]), 1.0),
        Claim("the error on unseen points falls at every step", share([c.score.falls for c in stepped]), 1.0),
        *_coverage_claims(cases),
        Claim("of all cases with planted effects of the catalogue, none was given a name too many",
              share([not c.score.false for c in cases if c.kind in KNOWN])),
        Claim(f"a diagnosis took {QUICK_S:g} s or less", share([c.seconds <= QUICK_S for c in cases])),
    ]  # fmt: skip


def _coverage_claims(cases: Sequence[Tried]) -> list[Claim]:
    """Return of all intervals, and of each sort of numbers, how many contain the truth."""
    effects = {e for c in cases for e in c.planted}
    marks = [(key.partition(".")[0] in effects, mark) for key, some in coverage(cases).items() for mark in some]
    return [
        Claim("90 % intervals contain the truth, where the effects were named right: all numbers",
              share([mark for _, mark in marks]), 0.80, 0.97),
        Claim("the same, numbers of effects", share([mark for of_effect, mark in marks if of_effect])),
        Claim("the same, numbers of the base pixel", share([mark for of_effect, mark in marks if not of_effect])),
    ]  # fmt: skip


def falls(cases: Sequence[Tried]) -> list[Fall]:
    """Return how far the error fell where an effect was added, for each kind of cases that has some."""
    found = []
    for kind in KNOWN:
        mine = [c.score for c in cases if c.kind == kind and len(c.score.errors) > 1]
        if mine:
            found.append(Fall(
                kind, len(mine), *(_quartiles([s.errors[i] for s in mine]) for i in (0, -1)),
                *(_quartiles([s.unseen[i] for s in mine]) for i in (0, -1)),
            ))  # fmt: skip
    return found


def _quartiles(values: Sequence[float]) -> tuple[float, ...]:
    """Return the quartiles of what is known."""
    known = [v for v in values if math.isfinite(v)]
    return tuple(float(q) for q in np.quantile(known, (0.25, 0.5, 0.75))) if known else (math.nan,) * 3


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
