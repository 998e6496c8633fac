"""`evs-bench devices`: which drivers there are, and what answers on a station."""

from __future__ import annotations

import click

from bench.commands.common import effects_option, json_option, print_json, print_table, station_option

__all__ = ["command"]


@click.command(name="devices")
@station_option
@effects_option
@json_option
def command(station: str, as_json: bool) -> None:
    """Connect to every device of a station, and say who answers. Nothing is lit."""
    from bench.station import load_station, stations

    with load_station(station) as bench:
        bench.connect()
        identities = bench.identities()
    if as_json:
        print_json(
            {"format": "evs-bench-devices/1", "station": bench.name, "stations": [*stations()], "devices": identities}
        )
        return
    rows = [(role, *(identity.get(key, "") for key in _KEYS)) for role, identity in identities.items()]
    print_table(("role", *_KEYS), rows)
    click.echo(f"\nstation {bench.name}; shipped stations: {', '.join(stations())}")


_KEYS = ("maker", "model", "serial", "firmware")
