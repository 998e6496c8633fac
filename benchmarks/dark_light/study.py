"""The study of dark light: fifteen sensors, a hundred runs each; it goes on where it was stopped.

python -m benchmarks.dark_light                 all runs that are not finished
python -m benchmarks.dark_light --runs 5        at the most five of each sensor
python -m benchmarks.dark_light --report        the report alone
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench.analysis.whole import analyze
from bench.characterize.families import families_in
from bench.characterize.family_result import family_result
from bench.characterize.readings import Uncertainties
from bench.compute import Workforce
from benchmarks.dark_light.report import report_text
from benchmarks.dark_light.runs import simulate
from benchmarks.dark_light.settings import SETTINGS, THETA_ON
from benchmarks.planted.results import append, finished, read

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.dark_light.settings import Setting

__all__ = ["Trial", "main", "run_trial"]

_ROOT: Final = Path(__file__).resolve().parents[2]
_REPORT: Final = _ROOT / "docs" / "reference" / "dark-light.md"
_RESULTS: Final = _ROOT / "build" / "dark_light" / "results.jsonl"
_RUNS: Final = 100
_SEED: Final = 1


@dataclass(frozen=True, slots=True)
class Trial:
    """One run of one sensor."""

    setting: Setting
    number: int

    @property
    def name(self) -> str:
        """Its name in results."""
        return f"{self.setting.name}-{self.number:03d}"


def run_trial(trial: Trial) -> dict[str, Any]:
    """Simulate a run, characterise it, and return what came out beside the truth."""
    begin = time.perf_counter()
    run = simulate(trial.setting, 1000 * _SEED + trial.number)
    simulated = time.perf_counter()
    analysis = analyze(run, pixel_maps=False, theta_fit=lambda _: None)
    (family,) = families_in(analysis)
    found = family_result(family, run.taken, analysis.run_id, Uncertainties(), 0.25 / 0.30)
    record = {
        "name": trial.name, "study_seed": _SEED, "setting": trial.setting.name, "true_lux": trial.setting.dark_lux,
        "lux": found.dark_lux.value, "low": found.dark_lux.low, "high": found.dark_lux.high,
        "by_intercept": found.by_intercept.dark_lux.value if found.by_intercept else None,
        "by_half": found.by_half.dark_lux.value if found.by_half else None, "why_no_fit": found.why_no_fit,
        "theta": found.theta.value, "theta_low": found.theta.low, "theta_high": found.theta.high,
        "true_theta": THETA_ON, "simulation_s": simulated - begin, "seconds": time.perf_counter() - begin,
    }  # fmt: skip
    if found.fit is not None:
        record |= {name: getattr(found.fit.family, name) for name in found.fit.free}
        record |= {"chi2": found.fit.chi2, "dof": found.fit.dof}
    if found.constant is not None:
        record["constant_p"] = found.constant.p_value
    return record


def main(arguments: Sequence[str]) -> int:
    """Run the study from a command line; return 1 if runs failed."""
    parser = argparse.ArgumentParser(prog="benchmarks.dark_light", description="study of the dark light")
    parser.add_argument("--runs", type=int, default=_RUNS, help="of each sensor, at the most")
    parser.add_argument("--only", default="", help="sensors whose name begins so")
    parser.add_argument("--workers", type=int, default=1, help="runs side by side")
    parser.add_argument("--results", type=Path, default=_RESULTS, help="file of finished runs; it is gone on with")
    parser.add_argument("--report", action="store_true", help="write the report of what is finished, and run nothing")
    parser.add_argument("--docs", type=Path, default=_REPORT, help="the report")
    asked = parser.parse_args(arguments)
    if not asked.report:
        _run(asked.results, asked.runs, asked.only, asked.workers)
    asked.docs.write_text(report_text(read(asked.results)), encoding="utf-8")
    print(f"the report is in {asked.docs}")
    return 0


def _run(results: Path, runs: int, only: str, workers: int) -> None:
    results.parent.mkdir(parents=True, exist_ok=True)
    done = finished(results, _SEED)
    trials = [Trial(s, n) for n in range(runs) for s in SETTINGS if s.name.startswith(only)]
    left = [t for t in trials if t.name not in done]
    _tell(f"{len(trials) - len(left)} of {len(trials)} runs were finished before")
    with Workforce(workers).open(_tell) as executor:
        for count, (index, record) in enumerate(executor.map(run_trial, left, name=lambda t: t.name), start=1):
            append(results, record)
            _tell(
                f"{count}/{len(left)}  {left[index].name}: {1e3 * record['lux']:.1f} "
                f"[{1e3 * record['low']:.1f}, {1e3 * record['high']:.1f}] mlux, true {1e3 * record['true_lux']:.1f}; "
                f"{record['seconds']:.1f} s"
            )


def _tell(text: str) -> None:
    sys.stderr.write(f"{text}\n")
