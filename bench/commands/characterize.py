"""`evs-bench characterize`: from families of S-curves to the numbers of a sensor."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from bench.commands.common import json_option, print_json, results_folder, results_option, say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.characterize.readings import Uncertainties
    from bench.characterize.result import Characterization
    from bench.store.data import Sensor

__all__ = ["command"]

_RELATIVE = click.FloatRange(min=0.0, max=1.0)


@click.command(name="characterize")
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--light-sd",
    type=_RELATIVE,
    help="Standard error of the illuminance on the chip, relative; without it what the points tell.",
)
@click.option(
    "--contrast-sd",
    type=_RELATIVE,
    default=0.0,
    show_default=True,
    help="Standard error that all log contrasts have in common, ln units.",
)
@click.option(
    "--nd-sd",
    type=click.FloatRange(min=0.0, max=3.0),
    help="Standard error of the optical density of the filters; without it the density is fitted where levels "
    "with and without a filter tell it, else taken as exact.",
)
@click.option(
    "--eta-sd", type=_RELATIVE, default=0.0, show_default=True, help="Standard error of the quantum efficiency."
)
@click.option(
    "--probability-sd",
    type=click.FloatRange(min=1e-6, max=1.0),
    help="Standard error of the shares in a CSV file that has no column for it.",
)
@click.option(
    "--model",
    "model_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the numbers as a pixel model into this file, for simulation and comparison.",
)
@click.option(
    "--v2e",
    "v2e_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the numbers as options of the simulator v2e into this file.",
)
@results_option
@json_option
def command(
    runs: tuple[Path, ...], light_sd: float | None, contrast_sd: float, nd_sd: float | None, eta_sd: float,
    probability_sd: float | None, model_file: Path | None, v2e_file: Path | None, out: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Turn runs of one sensor into its numbers: threshold, dark light, noise, bandwidth, mismatch.

    RUNS are run folders, or one CSV file of curves that were measured elsewhere, with the columns log_contrast,
    probability and baseline_lux. Tables are printed, and written with figures to the folder `characterization` of
    the first run; those of a file with --out only.
    """
    from bench.characterize.readings import Uncertainties

    beside = Uncertainties(light_sd, contrast_sd, nd_sd, eta_sd)
    if any(run.suffix.lower() == ".csv" for run in runs):
        found, sensor, folder = _of_curves(runs, beside, probability_sd), None, out
    else:
        found, sensor, folder = _of_runs(runs, beside, out)
    _show(found, folder, as_json)
    _export(found, model_file, v2e_file, sensor)


def _of_curves(runs: Sequence[Path], beside: Uncertainties, probability_sd: float | None) -> Characterization:
    from bench.characterize.characterize import characterize_curves
    from bench.characterize.digitised import digitised_families, read_points
    from protocols.errors import InputError

    if len(runs) > 1:
        raise InputError("a CSV file is characterised by itself; expected one file, or run folders")
    return characterize_curves(runs[0].name, digitised_families(read_points(runs[0], probability_sd)), beside)


def _of_runs(
    runs: Sequence[Path], beside: Uncertainties, out: Path | None
) -> tuple[Characterization, Sensor, Path]:  # fmt: skip
    from bench.characterize.characterize import characterize
    from bench.logs import LOG_FILE, log_into
    from bench.store import Run

    opened = [Run.open(run).without_damaged() for run in runs]
    results = results_folder(runs[0], out)
    with log_into(results / LOG_FILE):
        found = characterize(opened, beside, say)
    return found, opened[0].header.sensor, results / "characterization"


def _show(found: Characterization, folder: Path | None, as_json: bool) -> None:
    from bench.characterize.saving import save, to_dict
    from bench.characterize.wording import summary_lines

    if folder is not None:
        from bench.report.characterization import draw_characterization

        save(found, folder)
        draw_characterization(folder)
    if as_json:
        print_json(to_dict(found))
    else:
        for line in summary_lines(found):
            click.echo(line)
    if folder is not None:
        say(f"tables and figures are in {folder}")


def _export(
    found: Characterization, model_file: Path | None, v2e_file: Path | None, sensor: Sensor | None
) -> None:  # fmt: skip
    from bench.characterize.export import model_numbers, v2e_options
    from bench.models.characterized import characterized_model_text
    from bench.store.durable import replace_file

    if model_file is not None:
        replace_file(model_file, characterized_model_text(model_numbers(found, sensor)).encode())
        say(f"the pixel model is in {model_file}")
    if v2e_file is not None:
        replace_file(v2e_file, v2e_options(found).encode())
        say(f"the options of v2e are in {v2e_file}")
