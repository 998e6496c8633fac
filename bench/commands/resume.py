"""`evs-bench resume`: the rest of a simulated run that was stopped."""

from __future__ import annotations

from pathlib import Path

import click

from bench.commands.common import blind_station_option, effects_option, json_option, trace_option
from bench.commands.running import (
    OperatorSteps,
    operator_option,
    print_result,
    take_the_rest,
    workforce_of,
    workforce_options,
)

__all__ = ["command"]


@click.command(name="resume")
@click.argument("run", type=click.Path(path_type=Path))
@blind_station_option
@effects_option
@trace_option
@workforce_options
@operator_option
@json_option
def command(
    run: Path, station: str | None, workers: int, cluster: str | None, operator_steps: OperatorSteps, as_json: bool
) -> int:
    """Take the points of RUN that are not done: it was stopped, or killed.

    The events are those of a run that was never stopped, whoever measures them. For simulated stations only, so far.

    Example:  evs-bench resume my_run --workers 4
    """
    result = take_the_rest(run, station, operator_steps, workforce_of(workers, cluster))
    return print_result(result, as_json)
