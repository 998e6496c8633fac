"""The planted-effect study: runs its cases side by side, and writes what came out into the documentation.

Run with ``make study`` or ``python -m benchmarks.planted``. It can be stopped at any time, and goes on where it was;
the report is written of the cases of which both is finished, the sizes of the effects and the diagnosis::

    python -m benchmarks.planted --only none --limit 10     ten cases with nothing planted
    python -m benchmarks.planted --report                   the report alone
    python -m benchmarks.planted --sizes-only               the sizes, which do not depend on how a diagnosis searches
    python -m benchmarks.planted --diagnoses-only
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bench.compute import Workforce
from bench.run.software import revision
from benchmarks.planted.cases import KINDS, cases
from benchmarks.planted.results import append, finished, joined, read
from benchmarks.planted.score import score
from benchmarks.planted.trial import Trial, run_floor, run_sizes, run_trial
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from typing import Any

    from benchmarks.planted.cases import Case

__all__ = ["main", "run_study", "wanted"]

_ROOT: Final = Path(__file__).resolve().parents[2]
_DOCS: Final = _ROOT / "docs" / "reference"
#: Finished cases are kept beside the report, so that a study of many hours goes on in any checkout.
_RESULTS: Final = _DOCS / "planted-study"
_SIZES, _DIAGNOSES, _FLOORS = "sizes.jsonl", "cases.jsonl", "floors.jsonl"
#: What is done with each case, and the file that it goes to.
_WORK: Final[Mapping[str, Callable[[Trial], dict[str, Any]]]] = {_SIZES: run_sizes, _DIAGNOSES: run_trial}
#: and with those whose diagnosis leaves more than chance usually leaves of the truth.
_AFTERWARDS: Final[Mapping[str, Callable[[Trial], dict[str, Any]]]] = {_FLOORS: run_floor}


def wanted(seed: int, only: Sequence[str] = (), limit: int | None = None) -> list[Case]:
    """Return the cases to run: of each kind in turn, so that a study that was stopped has some of each.

    Parameters
    ----------
    only
        Kinds, or names of cases; empty for all.
    limit
        At the most so many of each kind.

    Raises
    ------
    InputError
        There is no such kind or case.
    """
    every = cases(seed)
    for name in only:
        if name not in KINDS and all(c.name != name for c in every):
            raise InputError(f"no cases {name!r}; expected {', '.join(KINDS)}, or the name of a case as single-003")
    chosen = [c for c in every if not only or c.kind in only or c.name in only]
    chosen = [c for c in chosen if limit is None or c.number < limit or c.name in only]
    return sorted(chosen, key=lambda c: c.number / KINDS[c.kind])


def run_study(
    chosen: Sequence[Case],
    results: Path,
    seed: int,
    workers: int = 1,
    tell: Callable[[str], None] = print,
    work: Mapping[str, Callable[[Trial], dict[str, Any]]] = _WORK,
) -> int:
    """Run what is not in the files of results yet; return how much failed.

    What fails is told, and tried again when the study is run again; the others go on. A case that is not what it was
    counts as new.

    Parameters
    ----------
    results
        Folder of the files.
    work
        What is done with each case, by the name of the file that it goes to.
    """
    results.mkdir(parents=True, exist_ok=True)
    done = {name: finished(results / name, seed, chosen) for name in work}
    trials = [Trial(c, seed, _revision()) for c in chosen]
    left = [(name, one) for one in trials for name in work if one.case.name not in done[name]]
    tell(f"{len(trials) * len(work) - len(left)} of {len(trials) * len(work)} were finished before")
    begin, count, failed = time.monotonic(), 0, 0
    with Workforce(workers).open(tell) as executor:
        for index, record in executor.map(_Caught(work), left, name=lambda one: f"{one[1].case.name}, {one[0]}"):
            count += 1
            left_min = (time.monotonic() - begin) / count * (len(left) - count) / 60.0
            name, trial = left[index]
            if "failed" in record:
                failed += 1
                tell(f"{count}/{len(left)}  {trial.case.name}: failed: {record['failed']}")
                continue
            append(results / name, record)
            tell(f"{count}/{len(left)}  {_line(trial.case, record)}; {left_min:.0f} min left")
    return failed


@dataclass(frozen=True, slots=True)
class _Caught:
    """Works on a case; what it raises becomes its record, so that the others go on."""

    work: Mapping[str, Callable[[Trial], dict[str, Any]]]

    def __call__(self, one: tuple[str, Trial]) -> dict[str, Any]:
        name, trial = one
        try:
            return self.work[name](trial)
        except Exception as error:  # noqa: BLE001 - it is told, and the case is tried again next time
            return {"name": trial.case.name, "failed": f"{type(error).__name__}: {error}"}


def main(arguments: list[str]) -> int:
    """Run the study and write its report; return 1 if a case failed."""
    asked = _parser().parse_args(arguments)
    try:
        chosen = wanted(asked.seed, asked.only, asked.limit)
        failed = 0 if asked.report else _run(asked, chosen)
        records = joined(*(asked.results / name for name in (_DIAGNOSES, _SIZES, _FLOORS)))
        if not records:
            if not asked.report:
                return int(failed > 0)
            raise InputError(f"{asked.results}: no finished cases")
        from benchmarks.planted.report import write_report

        _tell(f"written: {write_report(records, asked.docs)}")
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return int(failed > 0)


def _run(asked: argparse.Namespace, chosen: Sequence[Case]) -> int:
    """Run what is asked for, and return how much failed."""
    work = {name: done for name, done in _WORK.items() if name in _files(asked)}
    failed = run_study(chosen, asked.results, asked.seed, asked.workers, _tell, work)
    if _DIAGNOSES in work:
        doubted = _above_the_floor(asked.results)
        again = [case for case in chosen if case.name in doubted]
        failed += run_study(again, asked.results, asked.seed, asked.workers, _tell, _AFTERWARDS)
    return failed


def _above_the_floor(results: Path) -> set[str]:
    """Return the names of the cases whose diagnosis asks what chance leaves of the truth."""
    return {r["name"] for r in read(results / _DIAGNOSES) if score(r["truth"], r["diagnosis"]).is_doubted}


def _files(asked: argparse.Namespace) -> tuple[str, ...]:
    if asked.sizes_only:
        return (_SIZES,)
    return (_DIAGNOSES,) if asked.diagnoses_only else (_SIZES, _DIAGNOSES)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="benchmarks.planted", description="planted-effect study")
    parser.add_argument("--seed", type=int, default=1, help="another seed, other cases")
    parser.add_argument("--only", action="append", default=[], metavar="KIND", help=f"{', '.join(KINDS)}, or a case")
    parser.add_argument("--limit", type=int, help="at the most so many of each kind")
    parser.add_argument("--workers", type=int, default=1, help="cases that run side by side")
    parser.add_argument("--results", type=Path, default=_RESULTS, help="folder of finished cases; it is gone on with")
    parser.add_argument("--docs", type=Path, default=_DOCS, help="folder for the report")
    alone = parser.add_mutually_exclusive_group()
    alone.add_argument("--sizes-only", action="store_true", help="find the sizes of effects, diagnose nothing")
    alone.add_argument("--diagnoses-only", action="store_true", help="diagnose, and find no sizes")
    parser.add_argument("--report", action="store_true", help="write the report of what is finished, and run nothing")
    return parser


def _line(case: Case, record: dict[str, Any]) -> str:
    planted = ", ".join(case.planted) or "nothing"
    if "sizes" in record:
        sizes = ", ".join(f"{e} {size:.1f}" for e, size in record["sizes"]["size"].items()) or planted
        return f"{case.name}: size of {sizes}"
    if "floor" in record:
        return f"{case.name}: the truth leaves {record['floor']:.3f}"
    found = score(record["truth"], record["diagnosis"])
    named = ", ".join("/".join(g) for g in found.groups) or "nothing"
    return f"{case.name}: {planted} -> {named}, {found.verdict}, {record['seconds']:.0f} s"


def _tell(line: str) -> None:
    print(line, flush=True)


def _revision() -> str:
    known = revision(_ROOT)
    return f"{known['revision'][:12]}{' (modified)' if known['modified'] else ''}" if known else "unknown"
