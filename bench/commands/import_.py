"""`evs-bench import`: a run made of recordings that were taken elsewhere."""

from __future__ import annotations

import contextlib
import logging
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bench.commands.common import json_option, print_json, say

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["command"]


class _Teller(logging.Handler):
    """Says warnings to the user as they come."""

    def emit(self, record: logging.LogRecord) -> None:
        """Say one."""
        say(f"warning: {record.getMessage()}")


@contextlib.contextmanager
def _warnings_told() -> Iterator[None]:
    logger, teller = logging.getLogger("evs_bench"), _Teller(logging.WARNING)
    # An error that ends the import is told by the command line itself.
    teller.addFilter(lambda record: record.levelno == logging.WARNING)
    logger.addHandler(teller)
    try:
        yield
    finally:
        logger.removeHandler(teller)


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

    with _warnings_told():
        run = import_folder(folder, out)
    if as_json:
        print_json({"format": "evs-bench-import/1", "run": str(run)})
    else:
        click.echo(str(run))
    say(f"analyse it with: evs-bench analyze {run}")
