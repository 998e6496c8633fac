"""`evs-bench devices`: which devices of a station answer, and what is plugged in."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final

import click

from bench.commands.common import effects_option, json_option, print_json, print_table, station_option, trace_option

if TYPE_CHECKING:
    from bench.station import Station

__all__ = ["command"]

_KEYS: Final = ("maker", "model", "serial", "firmware")


@click.command(name="devices")
@station_option
@click.option("--ports", is_flag=True, help="List as well what is plugged in: serial ports, cameras, instruments.")
@click.option(
    "--udev", is_flag=True, help="Print the udev rules that let you open the instruments, and do nothing else."
)
@effects_option
@trace_option
@json_option
def command(station: str, ports: bool, udev: bool, as_json: bool) -> int:
    """Connect to each device of a station, and say who answers and who does not. Nothing is lit.

    The exit status is 1 if a device does not answer.

    Examples:  evs-bench devices --station my_bench.yaml --ports

               evs-bench devices --udev | sudo tee /etc/udev/rules.d/60-evs-bench.rules
    """
    from bench.station import load_station, stations
    from drivers.transport.discovery import UDEV_RULES, plugged_in

    if udev:
        click.echo(UDEV_RULES, nl=False)
        return 0
    with load_station(station) as bench:
        name, (identities, missing) = bench.name, _roll_call(bench)
    seen = [asdict(one) for one in plugged_in()] if ports else None
    if as_json:
        print_json(
            {
                "format": "evs-bench-devices/1", "station": name, "stations": [*stations()], "devices": identities,
                "missing": missing, "plugged_in": seen,
            }
        )  # fmt: skip
        return 1 if missing else 0
    rows = [(role, *(identity.get(key, "") for key in _KEYS)) for role, identity in identities.items()]
    print_table(("role", *_KEYS), [*rows, *((role, "missing", *[""] * (len(_KEYS) - 1)) for role in missing)])
    for reason in missing.values():
        click.echo(f"missing: {reason}")
    if seen is not None:
        _print_ports(seen)
    click.echo(f"\nstation {name}; shipped stations: {', '.join(stations())}")
    return 1 if missing else 0


def _roll_call(bench: Station) -> tuple[dict[str, dict[str, str]], dict[str, str]]:
    """Connect to each device by itself, and return who answered, and why the others did not, by role."""
    from bench.station.station import DevicesFailed

    answered: dict[str, dict[str, str]] = {}
    missing: dict[str, str] = {}
    for role in bench.devices:
        try:
            answered[role] = bench.connect_one(role)
        except DevicesFailed as error:
            missing[role] = "; ".join(error.lines)
    return answered, missing


def _print_ports(seen: list[dict[str, Any]]) -> None:
    click.echo("\nplugged in:" if seen else "\nnothing is plugged in that a driver knows")
    if seen:
        print_table(("port", "what", "serial", ""), [(p["path"], p["what"], p["serial"], p["refused"]) for p in seen])
