"""`evs-bench rerun`: a simulated run once more."""

from __future__ import annotations

from pathlib import Path

import click

from bench.commands.common import blind_station_option, effects_option, json_option
from bench.commands.notifying import notify_option
from bench.commands.running import (
    OperatorSteps,
    operator_option,
    print_result,
    take_again,
    workforce_of,
    workforce_options,
)

__all__ = ["command"]


@click.command(name="rerun")
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Run folder to make; default is runs/ID.")
@blind_station_option
@effects_option
@workforce_options
@operator_option
@notify_option
@json_option
def command(
    run: Path,
    out: Path | None,
    station: str | None,
    workers: int,
    cluster: str | None,
    operator_steps: OperatorSteps,
    notify: Path | None,
    as_json: bool,
) -> int:
    """Take RUN again, from the protocol, station and seed that are written in it.

    On a simulated station the events are the same, one by one.

    Example:  evs-bench rerun my_run --out again
    """
    result = take_again(run, station, out, operator_steps, workforce_of(workers, cluster), notify)
    return print_result(result, as_json)
