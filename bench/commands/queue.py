"""`evs-bench queue`: several runs one after the other, through the night."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from bench.commands.common import effects_option, json_option, print_json, print_table, say, trace_option
from bench.commands.notifying import notify_option
from bench.commands.running import (
    OperatorSteps,
    ask_operator,
    operator_option,
    workforce_of,
    workforce_options,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.queueing import LoadedQueue, QueueResult
    from bench.queueing.journal import Past
    from bench.queueing.summary import QueueSummary

__all__ = ["command"]

_STOPPED: Final = 130
#: Exit codes of a queue in which runs failed, by the worst cause.
_CODES: Final = {"bug": 70, "device": 2, "input": 1}


@click.command(name="queue")
@click.argument("file", required=False, type=click.Path(path_type=Path, dir_okay=False))
@click.option("--station", metavar="S", help="Station of the entries that name none; default is simulated.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder to make for the queue; default is runs/ID.")
@click.option(
    "--resume",
    "resumed",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="FOLDER",
    help="Go on with the queue in FOLDER, that was stopped or killed.",
)
@click.option("--dry-run", is_flag=True, help="Only look all runs over, and say when each begins and ends.")
@notify_option
@effects_option
@trace_option
@workforce_options
@operator_option
@json_option
def command(
    file: Path | None,
    station: str | None,
    out: Path | None,
    resumed: Path | None,
    dry_run: bool,
    notify: Path | None,
    workers: int,
    cluster: str | None,
    operator_steps: OperatorSteps,
    as_json: bool,
) -> int:
    """Run the protocols that the queue FILE names, one after the other, each into a run folder of its own.

    All runs are looked over before anything is switched on. Reference runs between the others show drift. A run that
    fails does not keep the next from being taken, unless the file says so. What is done is never taken again: after a
    kill or Ctrl-C, go on with --resume.

    \b
    Examples:  evs-bench queue night.yaml --dry-run
               evs-bench queue night.yaml --out night --notify notices.yaml
               evs-bench queue --resume night
    """  # noqa: D301 - \b is click's own mark
    if file is None and resumed is None:
        raise click.UsageError("name a queue FILE, or a folder with --resume")
    if resumed is not None and (station is not None or out is not None):
        raise click.UsageError("--resume goes on as the queue was begun: leave out --station and --out")
    operator = _operator(operator_steps)
    if resumed is not None:
        from bench.queueing.running import asked_for

        queue, past = asked_for(resumed, file)
    else:
        from bench.queueing import load_queue

        queue, past = load_queue(Path(str(file)), station or "simulated"), None
    if dry_run:
        return _print_timetable(queue, past, operator, as_json)
    return _work(queue, past, resumed or out, notify, operator, (workers, cluster), as_json)


def _operator(steps: OperatorSteps) -> Callable[[str], None] | None:
    """Return who sees to the steps of a person; None if nobody can."""
    from bench.commands.common import interactive
    from bench.run import assume_done

    if steps == "assume":
        return assume_done
    return ask_operator if interactive() else None


def _print_timetable(
    queue: LoadedQueue, past: Past | None, operator: Callable[[str], None] | None, as_json: bool
) -> int:
    from bench.queueing.checking import check_queue, plan_to_dict, timetable, timetable_rows
    from bench.run.progress import duration_text

    warnings = check_queue(queue, operator)
    planned = timetable(queue, done=frozenset() if past is None else past.done)
    if as_json:
        print_json(plan_to_dict(queue, planned, warnings))
        return 0
    for line in warnings:
        say(f"warning: {line}")
    if not planned:
        say("all runs of this queue are done")
        return 0
    header = ("run", "name", "protocol", "station", "points", "takes", "begins", "ends", "")
    print_table(header, timetable_rows(planned))
    total_s = sum(p.run.longest_s for p in planned)
    click.echo(f"{len(planned)} runs, {duration_text(total_s)} at most, until {planned[-1].end:%Y-%m-%d %H:%M}")
    say("not in it: starting the instruments, writing files, and what a person has to do")
    return 0


def _work(
    queue: LoadedQueue,
    past: Past | None,
    folder: Path | None,
    notify: Path | None,
    operator: Callable[[str], None] | None,
    workers: tuple[int, str | None],
    as_json: bool,
) -> int:
    """Take the runs, and print what became of them."""
    from bench.notices import notifying
    from bench.queueing import QueueCrew, check_queue, resume_queue, run_queue
    from bench.run.progress import progress_for

    for line in check_queue(queue, operator):
        say(f"warning: {line}")
    with notifying(notify, say) as notifier:
        crew = QueueCrew(say, lambda: progress_for(sys.stderr), operator, workforce_of(*workers), notifier)
        if past is None or folder is None:
            result = run_queue(queue, folder, crew)
        else:
            result = resume_queue(queue, past, folder, crew)
    return _print_result(result, as_json)


def _print_result(result: QueueResult, as_json: bool) -> int:
    """Print what a queue left behind, and return the exit code."""
    from bench.queueing.summary import summarize

    summary = summarize(result)
    for line in summary.problems:
        say(line)
    if as_json:
        print_json(summary.to_dict())
    else:
        _print_tables(summary)
    say(f"{result.text}; everything is in {result.folder}")
    if result.left:
        say(f"go on with: evs-bench queue --resume {result.folder}")
    return _code(result)


def _print_tables(summary: QueueSummary) -> None:
    print_table(("run", "name", "state", "points", "took", "why"), summary.run_rows())
    rows = summary.drift_rows()
    if rows:
        click.echo(
            "\nreference runs, with one standard deviation; where nothing drifted, chi2/dof is about 1 or less"
        )
        print_table(("quantity", "unit", "runs", "first", "last", "change", "chi2/dof"), rows)


def _code(result: QueueResult) -> int:
    """Return the exit code: 0 if all is done, else that of the worst that happened."""
    if result.stopped_by_operator:
        return _STOPPED
    causes = {outcome.cause for outcome in result.outcomes if outcome.state != "done"}
    found = [code for cause, code in _CODES.items() if cause in causes]
    return found[0] if found else int(bool(result.left))
