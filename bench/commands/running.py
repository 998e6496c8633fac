"""What `run`, `rerun` and `demo` share: taking the points, asking the operator, saying what came of it."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import click

from bench.commands.common import interactive, print_json, say

if TYPE_CHECKING:
    from pathlib import Path

    from bench.run import RunResult

__all__ = ["ask_operator", "print_result", "take", "take_again"]


def take(protocol: str, station: str, out: Path | None, seed: int | None) -> RunResult:
    """Run `protocol` on `station` with progress on stderr."""
    from bench.run import run_protocol
    from bench.run.progress import progress_for
    from bench.station import load_station
    from protocols import load_protocol

    return run_protocol(
        load_protocol(protocol),
        load_station(station),
        out,
        seed=seed,
        progress=progress_for(sys.stderr),
        operator=ask_operator,
    )


def take_again(run: Path, out: Path | None) -> RunResult:
    """Run again what is written in the run folder `run`."""
    from bench.run import rerun
    from bench.run.progress import progress_for

    return rerun(run, out, progress=progress_for(sys.stderr), operator=ask_operator)


def ask_operator(step: str) -> None:
    """Ask the operator to do `step`, and wait; without a terminal it is noted and taken as done."""
    if interactive():
        question = f"{step}; press Enter when it is done"
        click.prompt(question, default="", show_default=False, prompt_suffix=" ", err=True)
    else:
        say(f"operator step, taken as done because nobody sits at a terminal: {step}")


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
                "stopped": result.stopped,
            }
        )
    else:
        click.echo(str(result.folder))
    if result.stopped:
        say(f"stopped after {result.done} of {result.total} points; they are kept in {result.folder}")
        return 130
    say(f"{result.done} points; make the report with: evs-bench report {result.folder}")
    return 0
