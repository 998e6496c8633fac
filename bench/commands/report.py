"""`evs-bench report`: one HTML file, figures and tables."""

from __future__ import annotations

from pathlib import Path

import click

from bench.commands.common import json_option, print_json, results_folder, results_option, say

__all__ = ["command"]


@click.command(name="report")
@click.argument("run", type=click.Path(path_type=Path))
@results_option
@json_option
def command(run: Path, out: Path | None, as_json: bool) -> None:
    """Make the report of the run folder RUN, in RUN/report: one HTML file, figures as PNG and PDF, tables as CSV."""
    from bench.commands.evaluating import evaluate, make_report
    from bench.logs import LOG_FILE, log_into
    from bench.store import Run

    opened = Run.open(run).without_damaged()
    results = results_folder(run, out)
    with log_into(results / LOG_FILE):
        analysis, _ = evaluate(opened, results)
        page = make_report(opened, analysis, results)
    if as_json:
        print_json({"format": "evs-bench-report/1", "run": str(run), "report": str(page)})
    else:
        click.echo(str(page))
    say("open it in a browser; figures and tables lie beside it")
