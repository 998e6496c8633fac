"""`evs-bench runs`: which runs there are."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from bench.catalogue.entry import STATES, VERDICTS
from bench.commands.common import json_option, print_json, say

if TYPE_CHECKING:
    from bench.catalogue.catalogue import Catalogue
    from bench.catalogue.entry import RunEntry

__all__ = ["command"]


@click.command(name="runs")
@click.argument("folder", type=click.Path(path_type=Path), default=Path("runs"))
@click.option("--since", metavar="DATE", help="Only runs begun on this day or later, e.g. 2026-11-20.")
@click.option("--until", metavar="DATE", help="Only runs begun on this day or earlier.")
@click.option(
    "--sensor", metavar="TEXT", default="", help="Only runs of a sensor whose name or serial has TEXT in it."
)
@click.option(
    "--protocol",
    metavar="TEXT",
    default="",
    help="Only runs of a protocol whose name or title has TEXT in it, or of this hash.",
)
@click.option("--station", metavar="TEXT", default="", help="Only runs on a station whose name has TEXT in it.")
@click.option("--state", type=click.Choice(STATES), help="Only runs that stand like this.")
@click.option("--verdict", type=click.Choice(VERDICTS), help="Only runs with a point of this verdict.")
@click.option("--rebuild", is_flag=True, help="Read every run anew, and do not trust the index.")
@json_option
def command(
    folder: Path,
    since: str | None,
    until: str | None,
    sensor: str,
    protocol: str,
    station: str,
    state: str | None,
    verdict: str | None,
    rebuild: bool,
    as_json: bool,
) -> int:
    """List the runs in FOLDER (default: runs), newest first; damaged ones and what is no run are named, too.

    What was read is kept in an index in FOLDER, the file .evs-bench-runs.sqlite, so that only new and changed runs
    are read. It can be deleted at any time. A narrow terminal shows fewer columns; --json has them all.

    Example:  evs-bench runs

    Example:  evs-bench runs /data/runs --since 2026-11-20 --sensor IMX636 --state finished
    """
    from bench.catalogue.catalogue import read_catalogue
    from bench.catalogue.selecting import Selection, parse_day

    wanted = Selection(
        since=parse_day(since) if since else None,
        until=parse_day(until, end=True) if until else None,
        sensor=sensor,
        protocol=protocol,
        station=station,
        state=state or "",
        verdict=verdict or "",
    )
    catalogue = read_catalogue(folder, rebuild=rebuild, tell=say)
    chosen = [entry for entry in catalogue.entries if wanted.takes(entry)]
    if catalogue.problem:
        say(catalogue.problem)
    if as_json:
        print_json(_payload(catalogue, chosen))
    else:
        _print(catalogue, chosen)
    return 0


def _payload(catalogue: Catalogue, chosen: list[RunEntry]) -> dict[str, object]:
    return {
        "format": "evs-bench-runs/1",
        "folder": str(catalogue.folder),
        "runs": [entry.to_dict() for entry in chosen],
    }


def _print(catalogue: Catalogue, chosen: list[RunEntry]) -> None:
    from bench.catalogue.telling import runs_text

    if text := runs_text(chosen):
        click.echo(text)
    total = sum(entry.is_run for entry in catalogue.entries)
    found = sum(entry.is_run for entry in chosen)
    of = f"{found} of {total}" if found < total else f"{total}"
    say(f"{of} run{'' if total == 1 else 's'} in {catalogue.folder}")
