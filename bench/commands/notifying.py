"""The option `--notify` of the commands that take runs."""

from __future__ import annotations

from pathlib import Path

import click

__all__ = ["notify_option"]

notify_option = click.option(
    "--notify",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Who is told when the run ends, fails or stands still; default is the file in EVS_BENCH_NOTIFY.",
)
