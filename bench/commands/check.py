"""`evs-bench check`: what would happen, before anything is switched on."""

from __future__ import annotations

from pathlib import Path

import click

from bench.commands.common import effects_option, json_option, print_json, station_option

__all__ = ["command"]


@click.command(name="check")
@click.argument("protocol")
@station_option
@effects_option
@click.option(
    "--runs",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("runs"),
    show_default=True,
    help="Folder in which the run would lie beside earlier ones: from these the time is learned.",
)
@json_option
def command(protocol: str, station: str, runs: Path, as_json: bool) -> int:
    """Look PROTOCOL over: limits of the station, warnings, when it ends, size, what to do by hand and when.

    PROTOCOL is the name of a shipped protocol, or a file. Nothing is connected. The exit code is 1 if a point cannot
    be taken; warnings alone do not change it.

    Example:  evs-bench check on_family --station my_bench.yaml --runs /data/runs
    """
    from bench.run import check
    from bench.station import load_station
    from protocols import load_protocol

    report = check(load_protocol(protocol).protocol, load_station(station), runs)
    if as_json:
        print_json(report.to_dict())
    else:
        for line in report.lines():
            click.echo(line)
    return 1 if report.refused else 0
