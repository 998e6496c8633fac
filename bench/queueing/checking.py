"""Looking over all runs of a queue before anything is switched on, and when each of them begins and ends."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Any

from bench.run.progress import duration_text
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bench.queueing.loading import LoadedQueue
    from bench.queueing.plan import QueuedRun
    from bench.run import CheckReport

__all__ = ["PlannedRun", "check_queue", "plan_to_dict", "timetable", "timetable_rows"]


@dataclass(frozen=True, slots=True)
class PlannedRun:
    """A run of a queue, and when it begins and ends at the latest, local time."""

    run: QueuedRun
    points: int
    begin: datetime
    end: datetime

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        run = self.run
        return {
            "run": run.number,
            "name": run.name,
            "reference": run.is_reference,
            "protocol": run.protocol,
            "station": run.station,
            "seed": run.seed,
            "points": self.points,
            "on_failure": run.on_failure,
            "warm_up_s": run.warm_up.longest_s if run.warm_up else 0.0,
            "duration_s": run.duration_s,
            "begin": self.begin.isoformat(timespec="seconds"),
            "end": self.end.isoformat(timespec="seconds"),
        }


def check_queue(queue: LoadedQueue, operator: Callable[[str], None] | None) -> tuple[str, ...]:
    """Look all runs over, without connecting to anything.

    Parameters
    ----------
    queue
        The queue.
    operator
        Who sees to the steps of a person; None if nobody does.

    Returns
    -------
    warnings
        One line each.

    Raises
    ------
    InputError
        With everything because of which a run cannot be taken.
    """
    warnings: list[str] = []
    problems: list[str] = []
    for (protocol, station), runs in _kinds(queue.runs).items():
        report = _report(queue, protocol, station)
        where = f"{_runs_text(runs)} ({protocol} on {station})"
        lines = {"warning": warnings, "error": problems}
        for finding in report.findings:
            lines[finding.severity].append(f"{where}: {str(finding).removeprefix(f'{finding.severity}: ')}")
        if report.estimate.operator_steps and operator is None:
            problems.append(
                f"{where}: somebody has to do something between its points; run it at a terminal, or with "
                "--operator-steps assume if it needs no doing"
            )
    if problems:
        raise InputError(*problems)
    return tuple(warnings)


def _kinds(runs: Sequence[QueuedRun]) -> dict[tuple[str, str], list[int]]:
    """Return the numbers of the runs by protocol and station: each pair is looked at once."""
    found: dict[tuple[str, str], list[int]] = {}
    for run in runs:
        found.setdefault((run.protocol, run.station), []).append(run.number)
    return found


def _report(queue: LoadedQueue, protocol: str, station: str) -> CheckReport:
    from bench.run import check

    return check(queue.protocols[protocol].protocol, queue.stations[station].load())


def _runs_text(numbers: Sequence[int]) -> str:
    if len(numbers) == 1:
        return f"run {numbers[0]}"
    shown = ", ".join(map(str, numbers[:4]))
    return f"runs {shown}" + (f", ... {len(numbers)} in all" if len(numbers) > 4 else "")


def timetable(
    queue: LoadedQueue, begin: datetime | None = None, done: frozenset[int] = frozenset()
) -> tuple[PlannedRun, ...]:
    """Return when each run begins and ends at the latest, if the first begins now.

    Warm-ups are taken at their longest. What devices take to start, and files to be written, is not in it.

    Parameters
    ----------
    queue
        The queue.
    begin
        When the first run begins; default is now.
    done
        Numbers of the runs that are left out.
    """
    moment = begin or datetime.now().astimezone()
    planned = []
    for run in queue.runs:
        if run.number in done:
            continue
        end = moment + timedelta(seconds=run.longest_s)
        points = queue.protocols[run.protocol].protocol.estimate().points
        planned.append(PlannedRun(run, points, moment, end))
        moment = end
    return tuple(planned)


def timetable_rows(planned: Sequence[PlannedRun]) -> list[tuple[str, ...]]:
    """Return the timetable as rows of text: run, name, protocol, station, points, takes, begins, ends."""
    first_day = planned[0].begin.date()
    return [
        (
            str(p.run.number),
            p.run.name,
            p.run.protocol,
            p.run.station,
            str(p.points),
            duration_text(p.run.longest_s),
            _time_text(p.begin, first_day),
            _time_text(p.end, first_day),
            f"warm-up, {duration_text(p.run.warm_up.longest_s)} at most" if p.run.warm_up else "",
        )
        for p in planned
    ]


def _time_text(moment: datetime, first_day: object) -> str:
    return f"{moment:%H:%M}" if moment.date() == first_day else f"{moment:%a %H:%M}"


def plan_to_dict(queue: LoadedQueue, planned: Sequence[PlannedRun], warnings: Sequence[str]) -> dict[str, Any]:
    """Return the timetable as plain data, for programs."""
    return {
        "format": "evs-bench-queue-plan/1",
        "title": queue.title,
        "source": queue.source,
        "runs": [p.to_dict() for p in planned],
        "begin": planned[0].begin.isoformat(timespec="seconds"),
        "end": planned[-1].end.isoformat(timespec="seconds"),
        "warnings": list(warnings),
    }
