"""`evs-bench diff`: what differs between two runs."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import click

from bench.commands.common import json_option, print_json

__all__ = ["command"]

_DIFFERENT: Final = 3  #: exit code where it was asked for; 1 and 2 are those of errors

_run = click.Path(path_type=Path)


@click.command(name="diff")
@click.argument("left", metavar="RUN1", type=_run)
@click.argument("right", metavar="RUN2", type=_run)
@click.option("--no-points", is_flag=True, help="Compare run.yaml alone, and do not open the point files.")
@click.option("--exit-code", is_flag=True, help=f"Exit with {_DIFFERENT} if settings differ, for scripts.")
@json_option
def command(left: Path, right: Path, no_points: bool, exit_code: bool, as_json: bool) -> int:
    """Say what differs between the settings of RUN1 and of RUN2: protocol, station, sensor, window, seed, points.

    Each line has the value in RUN1, then that in RUN2; - where there is none. What is measured or only a name
    (temperatures, software, titles, times) is told apart, and does not make two runs different.

    Example:  evs-bench diff runs/monday runs/tuesday

    Example:  evs-bench diff runs/monday runs/tuesday --json --exit-code
    """
    from bench.catalogue.run_diff import diff_runs

    found = diff_runs(left, right, points=not no_points)
    if as_json:
        print_json(found.to_dict())
    else:
        for line in found.lines():
            click.echo(line)
    return _DIFFERENT if exit_code and not found.equal else 0
