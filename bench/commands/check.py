"""`evs-bench check`: what would happen, before anything is switched on."""

from __future__ import annotations

import click

from bench.commands.common import effects_option, json_option, print_json, station_option

__all__ = ["command"]


@click.command(name="check")
@click.argument("protocol")
@station_option
@effects_option
@json_option
def command(protocol: str, station: str, as_json: bool) -> int:
    """Look PROTOCOL over: limits of the station, warnings, time and size.

    PROTOCOL is the name of a shipped protocol, or a file. Nothing is connected. The exit code is 1 if a point cannot
    be taken; warnings alone do not change it.
    """
    from bench.run import check
    from bench.station import load_station
    from protocols import load_protocol

    report = check(load_protocol(protocol).protocol, load_station(station))
    if as_json:
        print_json(report.to_dict())
    else:
        for line in report.lines():
            click.echo(line)
    return 1 if report.refused else 0
