"""`evs-bench analyze`: from events to S-curves, thresholds and background rates."""

from __future__ import annotations

from pathlib import Path

import click

from bench.commands.common import json_option, print_json, results_folder, results_option, say

__all__ = ["command"]


@click.command(name="analyze")
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--no-pixel-maps", is_flag=True, help="Leave out the map of each pixel's own threshold.")
@results_option
@json_option
def command(run: Path, no_pixel_maps: bool, out: Path | None, as_json: bool) -> None:
    """Turn the run folder RUN into S-curves, thresholds and background rates.

    The tables are printed, and written to RUN/analysis.
    """
    from bench.analysis.tables import summary_lines, to_json
    from bench.commands.evaluating import evaluate
    from bench.logs import LOG_FILE, log_into
    from bench.store import Run

    opened = Run.open(run).without_damaged()
    results = results_folder(run, out)
    with log_into(results / LOG_FILE):
        analysis, folder = evaluate(opened, results, pixel_maps=not no_pixel_maps)
    if as_json:
        print_json(to_json(analysis))
    else:
        for line in summary_lines(analysis):
            click.echo(line)
    say(f"tables are in {folder}")
