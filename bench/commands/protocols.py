"""`evs-bench protocols`: the ready-made protocol files."""

from __future__ import annotations

from pathlib import Path

import click

from bench.commands.common import json_option, print_json, print_table, say

__all__ = ["command"]


@click.group(name="protocols", invoke_without_command=True)
@json_option
@click.pass_context
def command(ctx: click.Context, as_json: bool) -> None:
    """List the protocols that come with the bench; copy one to change it."""
    if ctx.invoked_subcommand is None:
        _list(as_json)


def _list(as_json: bool) -> None:
    from protocols import library, load_protocol

    found = []
    for name in library.names():
        protocol = load_protocol(name).protocol
        estimate = protocol.estimate()
        found.append((name, estimate.points, estimate.duration_s, protocol.title, estimate.added))
    if as_json:
        keys = ("name", "points", "duration_s", "title", "added")
        listing = [dict(zip(keys, row, strict=True)) for row in found]
        print_json({"format": "evs-bench-protocols/1", "protocols": listing})
        return
    rows = [
        (name, f"{'at most ' if added else ''}{points}", f"{seconds / 60:.0f} min", title)
        for name, points, seconds, title, added in found
    ]
    print_table(("name", "points", "takes", "what it measures"), rows)


@command.command()
@click.argument("name")
@click.option("--to", "target", type=click.Path(path_type=Path), help="File to write; default is NAME.yaml here.")
def copy(name: str, target: Path | None) -> None:
    """Copy the protocol NAME into a file of your own."""
    from protocols import library
    from protocols.errors import InputError

    text = library.text(name)
    target = target or Path(f"{name}.yaml")
    try:
        with target.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise InputError(f"{target} exists already; choose another file with --to") from None
    except OSError as error:
        raise InputError(f"{target} cannot be written: {error.strerror}") from None
    say(f"copied to {target}; look it over with: evs-bench check {target}")


@command.command()
@click.argument("name")
def show(name: str) -> None:
    """Print the protocol NAME."""
    from protocols import library

    click.echo(library.text(name), nl=False)


@command.command()
def schema() -> None:
    """Print the JSON Schema of protocol files, for editors."""
    from protocols.json_schema import protocol_json_schema

    print_json(protocol_json_schema())
