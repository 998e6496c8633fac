"""What a queue left behind, for the morning after: its runs, and what the references say of drift."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final

from bench.plain import json_text
from bench.queueing.drift import drift_of, drift_rows, read_references, write_drift
from bench.run.progress import duration_text
from bench.store.durable import replace_file

if TYPE_CHECKING:
    from bench.queueing.drift import Drift, Reading
    from bench.queueing.outcome import QueueResult, RunOutcome

__all__ = ["SUMMARY_FILE", "QueueSummary", "summarize"]

SUMMARY_FILE: Final = "summary.json"


@dataclass(frozen=True, slots=True)
class QueueSummary:
    """The runs of a queue, and the drift of its references."""

    result: QueueResult
    readings: tuple[Reading, ...]
    drifts: tuple[Drift, ...]
    problems: tuple[str, ...]  #: what of the references cannot be read

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, for programs."""
        result = self.result
        return {
            "format": "evs-bench-queue-result/1",
            "queue": str(result.folder),
            "title": result.title,
            "stopped": result.stopped_by_operator,
            "left": result.left,
            "runs": [outcome.to_dict() for outcome in result.outcomes],
            "drift": [_drift_dict(drift) for drift in self.drifts],
            "references": [asdict(reading) for reading in self.readings],
            "problems": list(self.problems),
        }

    def run_rows(self) -> list[tuple[str, ...]]:
        """Return the runs as rows of text: number, name, state, points, how long it took, why it is not done."""
        return [
            (str(o.run.number), o.run.name, o.state, _points_text(o), _took_text(o), o.reason or "")
            for o in self.result.outcomes
        ]

    def drift_rows(self) -> list[tuple[str, ...]]:
        """Return the drift as rows of text; empty where there are no references."""
        return drift_rows(self.drifts)


def summarize(result: QueueResult) -> QueueSummary:
    """Read the references of a queue, and write ``summary.json`` and ``drift.csv`` into its folder."""
    readings, problems = read_references(result.references)
    summary = QueueSummary(result, tuple(readings), tuple(drift_of(readings)), tuple(problems))
    if readings:
        write_drift(readings, result.folder)
    replace_file(result.folder / SUMMARY_FILE, (json_text(summary.to_dict()) + "\n").encode())
    return summary


def _drift_dict(drift: Drift) -> dict[str, Any]:
    return {
        "quantity": drift.quantity,
        "unit": drift.unit,
        "runs": drift.runs,
        "first": drift.first.value,
        "first_error": drift.first.error,
        "last": drift.last.value,
        "last_error": drift.last.error,
        "change": drift.change,
        "change_error": drift.change_error,
        "chi2_per_dof": drift.chi2_per_dof,
    }


def _points_text(outcome: RunOutcome) -> str:
    return "" if outcome.points_done is None else f"{outcome.points_done} of {outcome.points}"


def _took_text(outcome: RunOutcome) -> str:
    return "" if outcome.took_s is None else duration_text(outcome.took_s)
