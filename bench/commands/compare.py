"""`evs-bench compare`: a model, fitted, beside a run."""

from __future__ import annotations

from pathlib import Path

import click

from bench.commands.common import (
    effects_option,
    json_option,
    part_folder,
    print_json,
    results_folder,
    results_option,
    say,
)
from bench.commands.diagnosing import Teller, fit_options, model_of, open_runs, size_of

__all__ = ["command"]


@click.command(name="compare")
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN...")
@fit_options
@effects_option
@results_option
@json_option
def command(
    runs: tuple[Path, ...], model_file: str | None, seed: int, workers: int, whole: bool, out: Path | None,
    as_json: bool,
) -> None:  # fmt: skip
    """Fit a pixel model to RUN, and show where measurement and model disagree.

    The free numbers of the model are fitted; stimulus, settings and sensor come from the run. Several runs of one
    sensor are explained together. What is printed is also in RUN/comparison, with every residual in residuals.csv,
    what they do along each axis in by_axis.csv, and a page with figures of both. Data that are not fit to be judged
    are told so, with the reasons, and compared all the same.

    Example:  evs-bench compare my_run --model model.yaml
    """
    from bench.diagnosis.comparison import compare
    from bench.diagnosis.recorded.position import patterns, pixel_map
    from bench.diagnosis.telling.axis_wording import axis_lines
    from bench.diagnosis.telling.by_axis import by_axis, worst_places
    from bench.diagnosis.telling.saving import comparison_dict, save_comparison
    from bench.diagnosis.telling.wording import comparison_lines, head_line
    from bench.diagnosis.workers import processes
    from bench.logs import LOG_FILE, log_into
    from bench.report.comparison import write_comparison

    model = model_of(model_file)
    opened = open_runs(runs)
    results = results_folder(runs[0], out)
    folder = part_folder(results, "comparison")
    with log_into(results / LOG_FILE), Teller() as tell:
        comparison = compare(opened, model, seed=seed, workforce=processes(workers), tell=tell, whole=whole)
        tell("looking at the pixels' places")
        found = patterns(pixel_map([p for run in opened for p in run.points()]))
    places = worst_places(comparison.residuals, comparison.correlation)
    bins = by_axis(comparison.residuals, comparison.correlation)
    content = comparison_dict(comparison, found)
    folder.mkdir(exist_ok=True)
    save_comparison(comparison, content, folder)
    if as_json:
        print_json(content)
    else:
        click.echo(head_line(comparison.runs, *size_of(opened), comparison.findings))
        but = (f"fit to judge, but {caution}" for caution in comparison.cautions)
        for line in (*but, *comparison_lines(comparison, places, found), "", *axis_lines(bins)):
            click.echo(line)
    with Teller() as tell:
        tell("drawing the figures")
        page = write_comparison(comparison, bins, places, found, folder)
    say(f"the fitted model, all residuals and figures are in {folder}; open {page} in a browser")
