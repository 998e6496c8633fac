"""`evs-bench run`: take all points of a protocol on a station."""

from __future__ import annotations

from pathlib import Path

import click

from bench.commands.common import json_option, station_option

__all__ = ["command"]


@click.command(name="run")
@click.argument("protocol")
@station_option
@click.option("--out", type=click.Path(path_type=Path), help="Run folder to make; default is runs/ID.")
@click.option("--seed", type=click.IntRange(min=0), help="Seed of a simulated run, instead of the protocol's.")
@json_option
def command(protocol: str, station: str, out: Path | None, seed: int | None, as_json: bool) -> int:
    """Run PROTOCOL, the name of a shipped protocol or a file, and leave a run folder.

    Ctrl-C stops after the point that is being taken; a second Ctrl-C stops at once. Either way the light ends dark,
    and every point that was finished is kept.
    """
    from bench.commands.running import print_result, take

    result = take(protocol, station, out, seed)
    return print_result(result, as_json)
