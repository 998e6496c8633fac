"""`evs-bench run`: take all points of a protocol on a station."""

from __future__ import annotations

from pathlib import Path

import click

from bench.commands.common import SEED, effects_option, json_option, station_option, trace_option
from bench.commands.notifying import notify_option
from bench.commands.running import (
    OperatorSteps,
    operator_option,
    print_result,
    take,
    workforce_of,
    workforce_options,
)

__all__ = ["command"]


@click.command(name="run")
@click.argument("protocol")
@station_option
@effects_option
@trace_option
@click.option("--out", type=click.Path(path_type=Path), help="Run folder to make; default is runs/ID.")
@click.option("--seed", type=SEED, help="Seed of a simulated run, instead of all in the protocol.")
@workforce_options
@operator_option
@notify_option
@json_option
def command(
    protocol: str,
    station: str,
    out: Path | None,
    seed: int | None,
    workers: int,
    cluster: str | None,
    operator_steps: OperatorSteps,
    notify: Path | None,
    as_json: bool,
) -> int:
    """Run PROTOCOL, the name of a shipped protocol or a file, and leave a run folder.

    Ctrl-C stops after the point that is being taken; a second Ctrl-C stops at once. Either way the light ends dark,
    every point that was finished is kept, and evs-bench resume goes on. From another terminal: evs-bench pause,
    continue, abort.

    Points of a simulated station can be measured by several processes, or several machines; the events are the same.

    Example:  evs-bench run quick_look --workers 4 --out my_run
    """
    result = take(protocol, station, out, seed, operator_steps, workforce_of(workers, cluster), notify)
    return print_result(result, as_json)
