"""`evs-bench import`: a run made of recordings that were taken elsewhere."""

from __future__ import annotations

from pathlib import Path

import click

from bench.commands.common import json_option, print_json, say

__all__ = ["command"]


@click.command(name="import")
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Run folder to make; it must not exist.")
@json_option
def command(folder: Path, out: Path, as_json: bool) -> None:
    """Make a run of the recordings in FOLDER.

    FOLDER holds recordings (Prophesee RAW, EVT2, EVT2.1, EVT3, DAT, or HDF5 points) and recordings.yaml, which says
    how each of them was taken.
    """
    from bench.importing import import_folder

    run = import_folder(folder, out)
    if as_json:
        print_json({"format": "evs-bench-import/1", "run": str(run)})
    else:
        click.echo(str(run))
    say(f"analyse it with: evs-bench analyze {run}")
