"""`evs-bench rerun`: a simulated run once more."""

from __future__ import annotations

from pathlib import Path

import click

from bench.commands.common import json_option

__all__ = ["command"]


@click.command(name="rerun")
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Run folder to make; default is runs/ID.")
@json_option
def command(run: Path, out: Path | None, as_json: bool) -> int:
    """Take RUN again, from the protocol, station and seed that are written in it.

    On a simulated station the events are the same, one by one.
    """
    from bench.commands.running import print_result, take_again

    result = take_again(run, out)
    return print_result(result, as_json)
