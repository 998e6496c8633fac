"""`evs-bench selftest`: the first power-on of a station, measured."""

from __future__ import annotations

from pathlib import Path

import click

from bench.commands.common import (
    effects_option,
    json_option,
    print_json,
    print_table,
    say,
    station_option,
    trace_option,
)

__all__ = ["command"]


@click.command(name="selftest")
@station_option
@click.option(
    "--out", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE", help="A report to write, as Markdown."
)
@effects_option
@trace_option
@json_option
def command(station: str, out: Path | None, as_json: bool) -> int:
    """Look at every instrument of a station: levels, edges, filters, biases, dead time, triggers, lost data.

    The light goes through its whole range, and is dark at the end. The exit status is 1 if something is bad; "look"
    is for you to judge.

    Example:  evs-bench selftest --station my_bench.yaml --out selftest.md --trace bytes.txt
    """
    from bench.selftest.whole import run_selftest
    from bench.station import load_station
    from protocols.errors import InputError

    found = run_selftest(load_station(station), say)
    if out is not None:
        try:
            out.write_text(found.markdown(), encoding="utf-8")
        except OSError as error:
            raise InputError(f"{out}: cannot be written ({error.strerror})") from None
    if as_json:
        print_json(found.to_dict())
    else:
        print_table(
            ("", "device", "what", "found", "expected"),
            [(s.outcome, s.role, s.what, s.found, s.expected) for s in found.steps],
        )
        click.echo(f"\n{len(found.steps)} steps, {found.bad} bad")
    return 1 if found.bad else 0
