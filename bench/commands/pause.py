"""`evs-bench pause`: hold a run that is being taken, from another terminal."""

from __future__ import annotations

from pathlib import Path

import click

from bench.commands.running import ask_run

__all__ = ["command"]


@click.command(name="pause")
@click.argument("run", type=click.Path(path_type=Path))
def command(run: Path) -> int:
    """Pause RUN before its next point: the light is dark until it goes on.

    For a run that is being taken in another terminal. During a pause the bench may be touched: all settings are made
    again before the next point.

    Example:  evs-bench pause my_run
    """
    return ask_run(
        run,
        "pause",
        f"the run pauses before its next point, with the light dark; go on with: evs-bench continue {run}",
    )
