"""What `run`, `rerun` and `demo` share: taking the points, asking the operator, saying what came of it."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Literal

import click

from bench.commands.common import interactive, print_json, say

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bench.compute import Workforce
    from bench.notices import RunFacts
    from bench.run import RunResult
    from bench.station import Station

__all__ = [
    "OperatorSteps",
    "ask_operator",
    "ask_run",
    "operator_option",
    "print_result",
    "take",
    "take_again",
    "take_the_rest",
    "workforce_of",
    "workforce_options",
]

OperatorSteps = Literal["ask", "assume"]

_HEARD_WITHIN_S = 5.0

operator_option = click.option(
    "--operator-steps",
    type=click.Choice(["ask", "assume"]),
    default="ask",
    show_default=True,
    help="Wait at the terminal for what a person has to do, or take it as done.",
)


_workers_option = click.option(
    "--workers",
    type=click.IntRange(1),
    default=1,
    show_default=True,
    metavar="N",
    help="Processes on this machine that measure points; a simulated station only.",
)
_cluster_option = click.option(
    "--cluster",
    metavar="ADDRESS",
    help="Let the workers of a dask cluster measure the points, e.g. tcp://HOST:8786; a simulated station only.",
)


def workforce_options(command: Callable[..., int]) -> Callable[..., int]:
    """Give a command `--workers` and `--cluster`; :func:`workforce_of` reads them."""
    return _workers_option(_cluster_option(command))


def workforce_of(workers: int, cluster: str | None) -> Workforce:
    """Return who computes, by the options of :func:`workforce_options`."""
    from bench.compute import Workforce
    from bench.models.effect_sources import same_effects

    if cluster is not None and workers != 1:
        raise click.UsageError("--workers and --cluster exclude each other: the cluster has workers of its own")
    return Workforce(workers, cluster, setup=same_effects())


def take(
    protocol: str,
    station: str,
    out: Path | None,
    seed: int | None,
    steps: OperatorSteps = "ask",
    workforce: Workforce | None = None,
    notify: Path | None = None,
) -> RunResult:
    """Run `protocol` on `station` with progress on stderr, and with notices if `notify` or the environment asks."""
    from bench.notices import facts_of, notifying, with_notices
    from bench.run import check, run_protocol
    from bench.run.progress import progress_for
    from bench.station import load_station
    from protocols import load_protocol

    loaded, bench = load_protocol(protocol), load_station(station)
    for finding in check(loaded.protocol, bench).findings:
        if finding.severity == "warning":
            say(str(finding))
    with notifying(notify, say) as notifier:
        return with_notices(
            lambda progress: run_protocol(
                loaded,
                bench,
                out,
                seed=seed,
                progress=progress,
                operator=_operator(steps),
                workforce=workforce,
            ),
            progress_for(sys.stderr),
            notifier,
            lambda: facts_of(loaded.protocol, bench.name, out),
        )


def take_again(
    run: Path,
    station: str | None,
    out: Path | None,
    steps: OperatorSteps = "ask",
    workforce: Workforce | None = None,
    notify: Path | None = None,
) -> RunResult:
    """Run again what is written in the run folder `run`."""
    from bench.notices import notifying, with_notices
    from bench.run import rerun
    from bench.run.progress import progress_for

    bench = _given(station)
    with notifying(notify, say) as notifier:
        return with_notices(
            lambda progress: rerun(
                run, out, station=bench, progress=progress, operator=_operator(steps), workforce=workforce
            ),
            progress_for(sys.stderr),
            notifier,
            lambda: _facts_of_written(run, bench, out),
        )


def take_the_rest(
    run: Path,
    station: str | None,
    steps: OperatorSteps = "ask",
    workforce: Workforce | None = None,
    *,
    retry_skipped: bool = False,
    accept_differences: bool = False,
    notify: Path | None = None,
) -> RunResult:
    """Take the points of the run folder `run` that are not done."""
    from bench.notices import notifying, with_notices
    from bench.run import resume
    from bench.run.progress import progress_for

    bench = _given(station)
    with notifying(notify, say) as notifier:
        return with_notices(
            lambda progress: resume(
                run,
                station=bench,
                progress=progress,
                operator=_operator(steps),
                workforce=workforce,
                retry_skipped=retry_skipped,
                accept_differences=accept_differences,
            ),
            progress_for(sys.stderr),
            notifier,
            lambda: _facts_of_written(run, bench, run),
        )


def _facts_of_written(run: Path, station: Station | None, folder: Path | None) -> RunFacts:
    """Return what notices say of a run into `folder` of what is written in the run folder `run`."""
    from bench.notices import facts_of
    from bench.run.protocol_run import read_task

    _, protocol, written = read_task(run, station)
    return facts_of(protocol, written.name, folder)


def _given(station: str | None) -> Station | None:
    from bench.station import load_station

    return None if station is None else load_station(station)


def ask_run(folder: Path, wish: Literal["pause", "continue", "abort"], heard: str) -> int:
    """Tell the process that takes the run in `folder` what the operator wishes, and say what comes of it."""
    from bench.run.control import Wish, ask, was_heard

    ask(folder, Wish(wish))
    if was_heard(folder, _HEARD_WITHIN_S):
        say(heard)
    else:
        say(f"the run has not answered within {_HEARD_WITHIN_S:.0f} s; it will find the wish in {folder}")
    return 0


def ask_operator(step: str) -> None:
    """Ask the operator to do `step`, and wait; Ctrl-C and the end of the input stop the run."""
    question = f"{step}; press Enter when it is done, Ctrl-C to stop"
    try:
        click.prompt(question, default="", show_default=False, prompt_suffix=" ", err=True)
    except click.Abort:
        raise KeyboardInterrupt from None


def _operator(steps: OperatorSteps) -> Callable[[str], None] | None:
    """Return who sees to the steps of a person; None if nobody can: then a run that has some is refused."""
    if steps == "assume":
        return _assume
    return ask_operator if interactive() else None


def _assume(step: str) -> None:
    from bench.run import assume_done

    say(f"operator step, taken as done: {step}")
    assume_done(step)


def print_result(result: RunResult, as_json: bool) -> int:
    """Print what a run left behind, and return the exit code: 130 if it was stopped."""
    if as_json:
        print_json(
            {
                "format": "evs-bench-run-result/1",
                "run": str(result.folder),
                "id": result.run_id,
                "points_done": result.done,
                "points": result.total,
                "points_skipped": result.skipped,
                "stopped": result.stopped,
            }
        )
    else:
        click.echo(str(result.folder))
    if result.stopped:
        say(f"stopped after {result.done} of {result.total} points; they are kept in {result.folder}")
        if result.resumable:
            say(f"go on with: evs-bench resume {result.folder}")
        return 130
    if result.skipped:
        say(f"{result.skipped} points were skipped; try them again: evs-bench resume {result.folder} --retry-skipped")
    say(f"{result.done} points; make the report with: evs-bench report {result.folder}")
    return 0
