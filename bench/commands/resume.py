"""`evs-bench resume`: the rest of a run that was stopped."""

from __future__ import annotations

from pathlib import Path

import click

from bench.commands.common import effects_option, json_option, trace_option
from bench.commands.notifying import notify_option
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
@click.option(
    "--station", metavar="S", help="The station as it is now; default is the one that is written in the run."
)
@effects_option
@trace_option
@workforce_options
@operator_option
@click.option("--retry-skipped", is_flag=True, help="Try points again that were left out.")
@click.option(
    "--accept-differences", is_flag=True, help="Go on although station, devices or points are not what they were."
)
@notify_option
@json_option
def command(
    run: Path,
    station: str | None,
    workers: int,
    cluster: str | None,
    operator_steps: OperatorSteps,
    retry_skipped: bool,
    accept_differences: bool,
    notify: Path | None,
    as_json: bool,
) -> int:
    """Take the points of RUN that are not done: it was stopped, or killed.

    Points that are done are kept, unless their file is not there as it was written. Station, devices and protocol
    must be what they were; what differs is said. On a simulated station the events are those of a run that was never
    stopped, whoever measures them.

    Example:  evs-bench resume my_run
    """
    result = take_the_rest(
        run,
        station,
        operator_steps,
        workforce_of(workers, cluster),
        retry_skipped=retry_skipped,
        accept_differences=accept_differences,
        notify=notify,
    )
    return print_result(result, as_json)
