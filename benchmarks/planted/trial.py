"""One case: its sizes, what a diagnosis says of its run, or what the truth leaves there; none knows of another."""

from __future__ import annotations

import json
import math
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from benchmarks.planted.runs import make_run
from benchmarks.planted.sizes import sizes_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from benchmarks.planted.cases import Case

__all__ = ["MOST", "Trial", "diagnose_run", "run_floor", "run_sizes", "run_trial"]

MOST: Final = 3  #: effects that a diagnosis adds at the most


@dataclass(frozen=True, slots=True)
class Trial:
    """A case to be tried; it can be sent to another process."""

    case: Case
    study_seed: int
    revision: str


def run_trial(trial: Trial) -> dict[str, Any]:
    """Return the record of a diagnosis: truth, what it said, and how long it took."""
    case = trial.case
    with tempfile.TemporaryDirectory(prefix="planted-") as folder:
        run = make_run(case, Path(folder) / case.name)
        begin = time.monotonic()
        found = diagnose_run(run, case.left_out)
        seconds = time.monotonic() - begin
    return _plain({**_head(trial), "seconds": round(seconds, 2), "diagnosis": _kept(found)})


def run_sizes(trial: Trial) -> dict[str, Any]:
    """Return the record of the sizes of a case."""
    sizes = sizes_of(trial.case, mimics=trial.case.kind == "outside")
    return _plain({**_head(trial), "sizes": asdict(sizes)})


def run_floor(trial: Trial) -> dict[str, Any]:
    """Return the record of what the true model leaves of the run of a case."""
    from benchmarks.planted.floor import floor_of

    with tempfile.TemporaryDirectory(prefix="planted-") as folder:
        run = make_run(trial.case, Path(folder) / trial.case.name)
        return _plain({**_head(trial), "floor": floor_of(run, trial.case.model)})


def _head(trial: Trial) -> dict[str, Any]:
    return {
        "name": trial.case.name,
        "study_seed": trial.study_seed,
        "revision": trial.revision,
        "truth": trial.case.to_dict(),
    }


def diagnose_run(run: Path, left_out: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the JSON of the diagnosis of a run, made in this process, without what to measure next."""
    from bench.diagnosis.diagnosis import Diagnosis

    with Diagnosis(run, seed=1, workers=1, without=left_out) as diagnosis:
        found: dict[str, Any] = diagnosis.run(most=MOST, measure_next=False).to_dict()
    return found


def _kept(found: dict[str, Any]) -> dict[str, Any]:
    """Return a diagnosis without what no score needs: a file of hundreds is to be kept beside its report."""
    steps = [{k: v for k, v in step.items() if k not in ("candidates", "worst")} for step in found["steps"]]
    return {k: v for k, v in found.items() if k != "not_asked"} | {"steps": steps}


def _plain(record: Mapping[str, Any]) -> dict[str, Any]:
    plain: dict[str, Any] = json.loads(json.dumps(_finite(record)))
    return plain


def _finite(value: Any) -> Any:
    """Return plain values in which numbers that are not finite are null, as JSON has it."""
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
