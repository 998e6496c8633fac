"""`evs-bench continue`: let a run go on that is paused, from another terminal."""

from __future__ import annotations

from pathlib import Path

import click

from bench.commands.running import ask_run

__all__ = ["command"]


@click.command(name="continue")
@click.argument("run", type=click.Path(path_type=Path))
def command(run: Path) -> int:
    """Let RUN go on, which was paused.

    For a run that is being taken in another terminal; one that nobody is taking is gone on with by evs-bench resume.

    Example:  evs-bench continue my_run
    """
    return ask_run(run, "continue", "the run goes on")
