"""What the commands share: output, progress, and how an operator is asked."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

__all__ = [
    "SEED",
    "blind_station_option",
    "effects_option",
    "interactive",
    "json_option",
    "part_folder",
    "print_json",
    "print_table",
    "results_folder",
    "results_option",
    "say",
    "station_option",
    "trace_option",
]

SEED = click.IntRange(0, 2**63 - 1)

json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON, for programs, instead of a table.")
station_option = click.option(
    "--station", default="simulated", show_default=True, metavar="S", help="A shipped station, or a station file."
)

blind_station_option = click.option(
    "--station", metavar="FILE", help="The station file of a blind station, of which a run keeps only the name."
)


def _load_effects(ctx: click.Context, _param: click.Parameter, files: tuple[str, ...]) -> None:
    if files and not ctx.resilient_parsing:
        from bench.models.effect_sources import load_effect_files

        load_effect_files(files)


effects_option = click.option(
    "--effects",
    multiple=True,
    metavar="FILE",
    expose_value=False,
    callback=_load_effects,
    help="A Python file with an effect of your own; it is run. Can be given several times.",
)


def _start_trace(ctx: click.Context, _param: click.Parameter, file: Path | None) -> None:
    if file is not None and not ctx.resilient_parsing:
        from bench.station.tracing import tracing

        ctx.with_resource(tracing(file))


trace_option = click.option(
    "--trace",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    expose_value=False,
    callback=_start_trace,
    help="Write every byte to and from the instruments, with its time, into FILE.",
)

results_option = click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for what is made of the run; default is the run's own.",
)


def results_folder(run: Path, out: Path | None) -> Path:
    """Return the folder in which the results of `run` are written: `out`, or the run's own folder."""
    from bench.logs import LOG_FILE
    from protocols.errors import InputError

    folder = out or run
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / LOG_FILE).touch()
    except OSError as error:
        raise InputError(f"{folder}: cannot be written ({error.strerror}); name another folder with --out") from None
    return folder


def part_folder(results: Path, name: str) -> Path:
    """Return the folder that a part of the results will have; it is made later.

    What stands in its way is told before time is spent on the results.
    """
    from protocols.errors import InputError

    folder = results / name
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; expected a folder, or nothing")
    return folder


def say(text: str) -> None:
    """Tell the operator something that is not a result: it goes to stderr."""
    click.echo(text, err=True)


def print_json(payload: dict[str, Any]) -> None:
    """Print a result as JSON; numbers that are not finite become null."""
    from bench.plain import json_text

    click.echo(json_text(payload))


def print_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print rows of text in aligned columns; columns of numbers are aligned to the right."""
    table = [list(header), *[list(row) for row in rows]]
    widths = [max(len(row[i]) for row in table) for i in range(len(header))]
    right = [all(_is_number(row[i]) for row in table[1:]) for i in range(len(header))]
    for row in table:
        cells = (c.rjust(w) if r else c.ljust(w) for c, w, r in zip(row, widths, right, strict=True))
        click.echo("  ".join(cells).rstrip())


def _is_number(cell: str) -> bool:
    return not cell or cell[0] in "-+.0123456789"


def interactive() -> bool:
    """Return whether an operator sits at a terminal."""
    return sys.stdin is not None and sys.stdin.isatty() and sys.stderr.isatty()
