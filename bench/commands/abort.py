"""`evs-bench abort`: end a run that is being taken, from another terminal."""

from __future__ import annotations

from pathlib import Path

import click

from bench.commands.running import ask_run

__all__ = ["command"]


@click.command(name="abort")
@click.argument("run", type=click.Path(path_type=Path))
def command(run: Path) -> int:
    """End RUN now, also in the middle of a point, which is not kept; the light ends dark.

    For a run that is being taken in another terminal. All points that are finished stay, and evs-bench resume takes
    the rest.

    Example:  evs-bench abort my_run
    """
    return ask_run(run, "abort", f"the run ends now, with the light dark; take the rest with: evs-bench resume {run}")
