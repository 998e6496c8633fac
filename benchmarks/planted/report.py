"""The page of the study in the documentation, its numbers as JSON, and its figures."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from benchmarks.planted import numbers
from benchmarks.planted.cases import KINDS
from benchmarks.planted.score import share
from benchmarks.planted.sizes import ALIKE

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from benchmarks.planted.numbers import Claim, Fall, Tried

__all__ = ["PAGE", "write_report"]

PAGE: Final = "planted-study.md"
_FOLDER: Final = "planted-study"
_NUMBERS: Final = "planted-study.json"


def write_report(records: Sequence[Mapping[str, Any]], docs: Path) -> Path:
    """Write page, numbers and figures into `docs`, and return the path of the page."""
    cases = numbers.tried(records)
    folder = docs / _FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    _draw(cases, folder)
    text = json.dumps(_numbers(records, cases), indent=1, allow_nan=False) + "\n"
    (folder / _NUMBERS).write_text(text, encoding="utf-8")
    page = docs / PAGE
    page.write_text("\n".join(_lines(records, cases)) + "\n", encoding="utf-8")
    return page


def _draw(cases: Sequence[Tried], folder: Path) -> None:
    from bench.report.figures.style import house_style
    from benchmarks.planted.figures import draw_confusion, draw_detection

    with house_style():
        drawings = {
            "detection": draw_detection(numbers.detection(cases), cases),
            "confusion": draw_confusion(numbers.confusion(cases)),
        }
        for name, figure in drawings.items():
            figure.savefig(folder / f"{name}.png", metadata={"Software": None})


def _lines(records: Sequence[Mapping[str, Any]], cases: Sequence[Tried]) -> Iterator[str]:
    yield "# What the diagnosis finds, and what it does not"
    yield ""
    yield "Runs whose truth is known, diagnosed as any run is. Made by `make study` (`benchmarks/planted/`), from"
    yield f"seed {_seeds(records)} and revision {_revisions(records)}, sizes from {_revisions(records, 'sizes')};"
    yield f"{_counts(cases)}."
    yield ""
    yield from _METHOD
    yield ""
    yield "**Met** says whether the share itself is as asked, whatever its interval."
    yield ""
    yield "| what | asked | found (95 % interval) | met |"
    yield "|---|---|---|---|"
    for claim in numbers.claims(cases):
        yield f"| {claim.text} | {claim.asked} | {claim.found} | {_met(claim)} |"
    yield ""
    yield from _more(cases)
    yield ""
    yield from _falls(cases)
    yield f"![Share of single effects that are named first, by size]({_FOLDER}/detection.png)"
    yield ""
    yield f"What single effects of size {numbers.SEEN:g} or more were first named; a tied group that holds the"
    yield "planted effect counts as right."
    yield ""
    yield f"![What was named of each planted effect]({_FOLDER}/confusion.png)"
    yield ""
    yield "Intervals of 90 % that contain the truth, where the effects were named right:"
    yield ""
    yield "| number | contained |"
    yield "|---|---|"
    for key, marks in numbers.coverage(cases).items():
        yield f"| `{key}` | {share(marks)} |"
    yield ""
    yield from _floors(cases)
    yield from _misses(cases)
    yield f"All numbers, case by case: [{_NUMBERS}]({_FOLDER}/{_NUMBERS})."


_METHOD: Final = (
    "**Size** is the root of the expected fall of the deviance between the truth with and without the effect. It is",
    "worked out apart from any diagnosis, from simulated expectations, when the numbers of the base pixel and of",
    "other effects have taken up what they can; the chance in the simulations cancels in the product of two",
    "independent ones. Of gross effects it is what the straight line says, and only says that they are gross.",
    "",
    "**Runs** have 16 x 16 pixels and at most 40 points: constant light and square waves of two widths, at three to",
    "five light levels. The base pixel differs from case to case. A third of the runs was made by the reference",
    "engine at 13.7 or 6.7 us a step, which their time stamps do not tell: the model looks every 10 us. So",
    "were those of effects that no built-in one can express, at 17.3 us.",
    "",
    "**The floor** is 1: the deviance is scaled so that a true model leaves as much by degree of freedom, within",
    "chance, which is some 7 % in runs as small as these. Where the error of what explains a run is more than 10 %",
    "above 1, the floor is therefore what the true model leaves of the same run.",
    "",
    "**Outside** are effects that the diagnosis was not told of, and effects that no built-in one can express",
    "(`benchmarks/planted/strange_effects.py`). The nearest effect of the catalogue mimics one when less than",
    f"{ALIKE:g} standard errors are left beside it.",
)


def _counts(cases: Sequence[Tried]) -> str:
    parts = [f"{sum(c.kind == kind for c in cases)} of {count} {kind}" for kind, count in KINDS.items()]
    return f"finished are {', '.join(parts)}"


def _more(cases: Sequence[Tried]) -> Iterator[str]:
    right = [c for c in cases if c.kind == "single" and c.score.first_right]
    if right:
        alone = sum(len(c.score.groups[0]) == 1 for c in right)
        yield f"Groups in which a single effect was named hold {numbers.group_size(cases):.2f} effects on average;"
        yield f"{alone} of {len(right)} stood alone."
    middle, nine, longest = np.quantile([c.seconds for c in cases], (0.5, 0.9, 1.0))
    yield f"A diagnosis took {middle:.0f} s in the median, nine of ten {nine:.0f} s or less, the longest"
    yield f"{longest:.0f} s. Each ran in one process, with as many side by side as the study had processes; what to"
    yield "measure next was not looked for."


def _met(claim: Claim) -> str:
    return {True: "yes", False: "no", None: "-"}[claim.met]


def _falls(cases: Sequence[Tried]) -> Iterator[str]:
    """Yield how far the error fell where an effect was added."""
    found = numbers.falls(cases)
    if not found:
        return
    yield "Where an effect was added, the error before and at the end (quartiles: 25, 50, 75 %; the floor is 1):"
    yield ""
    yield "| cases | before | after | unseen points, before | unseen points, after |"
    yield "|---|---|---|---|---|"
    for fall in found:
        errors = (fall.before, fall.after, fall.unseen_before, fall.unseen_after)
        yield f"| {fall.count} {fall.kind} | {' | '.join(', '.join(map(_short, some)) for some in errors)} |"
    yield ""


def _short(error: float) -> str:
    return f"{error:.0f}" if error >= 100.0 else f"{error:#.3g}"


def _floors(cases: Sequence[Tried]) -> Iterator[str]:
    """Yield how much chance leaves of the truth where more than 1.1 was left by what explains a run."""
    doubted = [c for c in cases if c.score.is_doubted]
    if not doubted:
        return
    yield "Explained with an error of more than 1.1; the floor there is what the true model leaves, fitted to the"
    yield "same run from the true numbers on:"
    yield ""
    yield "| case | planted | named | error | true model |"
    yield "|---|---|---|---|---|"
    for case in doubted:
        floor = "not known yet" if case.truth_leaves is None else f"{case.truth_leaves:.3f}"
        yield f"| {case.name} | {_planted(case)} | {_named(case)} | {case.score.errors[-1]:.3f} | {floor} |"
    yield ""


def _misses(cases: Sequence[Tried]) -> Iterator[str]:
    """Yield the cases in which the diagnosis did not do what was asked."""
    rows = [row for case in cases for row in _miss(case)]
    if not rows:
        return
    yield "Cases in which it did not do what was asked:"
    yield ""
    yield "| case | planted (size) | named | verdict |"
    yield "|---|---|---|---|"
    yield from rows
    yield ""


def _miss(case: Tried) -> Iterator[str]:
    seen = case.smallest >= numbers.SEEN
    wrong = {
        "single": seen and not case.score.first_right,
        "several": seen and not case.score.all_named,
        "none": bool(case.score.groups),
        "outside": seen and numbers.is_strange(case) and (case.score.false > 0 or not case.score.unexplained),
    }[case.kind]
    if wrong:
        yield f"| {case.name} | {_planted(case)} | {_named(case)} | {case.score.verdict} |"


def _planted(case: Tried) -> str:
    return ", ".join(f"{e} ({case.size.get(e, math.nan):.3g})" for e in case.planted) or "nothing"


def _named(case: Tried) -> str:
    return ", ".join(" or ".join(g) for g in case.score.groups) or "nothing"


def _numbers(records: Sequence[Mapping[str, Any]], cases: Sequence[Tried]) -> dict[str, Any]:
    bins = numbers.detection(cases)
    return {
        "format": "evs-bench-planted-study/1",
        "seeds": sorted({r["study_seed"] for r in records}),
        "revisions": sorted({r["revision"] for r in records}),
        "sizes_revisions": sorted({r["sizes_revision"] for r in records}),
        "finished": {kind: sum(c.kind == kind for c in cases) for kind in KINDS},
        "claims": [
            {"what": c.text, "asked": c.asked, **c.found.to_dict(), "met": c.met} for c in numbers.claims(cases)
        ],
        "falls": [_fall(f) for f in numbers.falls(cases)],
        "mean_group": _plain(numbers.group_size(cases)),
        "detection": [
            {"from": b.low, "to": _plain(b.high), "middle": round(b.middle, 3), **b.found.to_dict()} for b in bins
        ],
        "confusion": [
            {"planted": p, "named": n, "count": count} for (p, n), count in numbers.confusion(cases).items()
        ],
        "coverage": {key: share(marks).to_dict() for key, marks in numbers.coverage(cases).items()},
        "cases": [_row(c) for c in cases],
    }


def _fall(fall: Fall) -> dict[str, Any]:
    plain = asdict(fall)
    return {k: [_plain(q) for q in v] if isinstance(v, tuple) else v for k, v in plain.items()}


def _row(case: Tried) -> dict[str, Any]:
    return {
        "name": case.name,
        "size": {k: round(v, 2) for k, v in case.size.items()} if case.size else dict.fromkeys(case.planted),
        "beyond_mimic": None if case.beyond_mimic is None else round(case.beyond_mimic, 2),
        "reference": case.reference,
        "groups": [list(g) for g in case.score.groups],
        "verdict": case.score.verdict,
        "floor": _plain(case.score.floor),
        "errors": [_plain(e) for e in case.score.errors],
        "unseen": [_plain(e) for e in case.score.unseen],
        "seconds": case.seconds,
    }


def _plain(value: float) -> float | None:
    return round(value, 4) if math.isfinite(value) else None


def _seeds(records: Sequence[Mapping[str, Any]]) -> str:
    return ", ".join(str(s) for s in sorted({r["study_seed"] for r in records}))


def _revisions(records: Sequence[Mapping[str, Any]], of: str = "") -> str:
    return ", ".join(sorted({r[f"{of}_revision" if of else "revision"] for r in records}))
