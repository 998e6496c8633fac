"""`evs-bench calibrate-noise`: the noise that gives a background rate."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from bench.commands.common import SEED, effects_option, json_option, print_json, say

if TYPE_CHECKING:
    from bench.models.noise_calibration import NoiseCalibration
    from bench.models.pixel_files import PixelModel

__all__ = ["command"]


@click.command(name="calibrate-noise")
@click.option("--target-hz", type=float, required=True, help="Events per pixel and second, ON and OFF together.")
@click.option("--corner-hz", type=float, help="Corner of the source follower's low-pass, Hz.")
@click.option("--theta-on", type=float, help="ON threshold, ln.")
@click.option("--theta-off", type=float, help="OFF threshold, ln.")
@click.option("--refractory-s", type=float, help="Dead time after an event, s.")
@click.option(
    "--model", "file", type=click.Path(path_type=Path), help="A pixel model with effects, instead of these."
)
@click.option("--lux", type=float, help="Illuminance on the chip, lux; needed with --model.")
@click.option("--dt-s", type=float, default=1e-5, show_default=True, help="Length of a sample, s.")
@click.option("--step", type=click.Choice(["exact", "euler"]), default="exact", show_default=True,
              help="Low-pass of continuous time, or as in the published simulation.")  # fmt: skip
@click.option("--pixels", type=click.IntRange(2), default=512, show_default=True, help="Pixels to simulate.")
@click.option("--seconds", type=click.FloatRange(0.0, min_open=True),
              help="Length of the counting, s; default is about 4000 events.")  # fmt: skip
@click.option("--wait-s", type=click.FloatRange(0.0),
              help="From the reset to the counting, s; default is until the rate is the lasting one.")  # fmt: skip
@click.option("--seed", type=SEED, default=1, show_default=True, help="Another seed, other events.")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), help="Folder for a figure and the numbers.")
@effects_option
@json_option
def command(
    target_hz: float,
    corner_hz: float | None,
    theta_on: float | None,
    theta_off: float | None,
    refractory_s: float | None,
    file: Path | None,
    lux: float | None,
    dt_s: float,
    step: Literal["exact", "euler"],
    pixels: int,
    seconds: float | None,
    wait_s: float | None,
    seed: int,
    out: Path | None,
    as_json: bool,
) -> None:
    """Find the noise that gives a background rate at constant light.

    The noise is the rms behind the source follower, in ln units. The pixel is given by its four numbers, or by a
    model file.

    Example: evs-bench calibrate-noise --target-hz 0.5 --corner-hz 200 --theta-on 0.3 --theta-off 0.3
    --refractory-s 1e-2
    """
    from bench.models.noise_calibration import calibrate_noise

    if out is not None:
        out.mkdir(parents=True, exist_ok=True)  # that it cannot be written is said before, not after the work
    base = {"corner_hz": corner_hz, "theta_on": theta_on, "theta_off": theta_off, "refractory_s": refractory_s}
    found = calibrate_noise(
        _model(base, file, lux),
        target_hz,
        lux=_ANY_LUX if lux is None else lux,
        dt_s=dt_s,
        step=step,
        pixels=pixels,
        seconds=seconds,
        wait_s=wait_s,
        seed=seed,
        tell=say,
    )
    if out is not None:
        _save(found, out)
    if as_json:
        print_json(found.to_dict())
        return
    for line in _lines(found):
        click.echo(line)


#: The base pixel has the same noise at any light.
_ANY_LUX = 10.0


def _model(base: dict[str, float | None], file: Path | None, lux: float | None) -> PixelModel:
    from bench.models.pixel_files import base_pixel, read_model_file

    names = {name: f"--{name.replace('_', '-')}" for name in base}
    if file is not None:
        given = [names[n] for n, value in base.items() if value is not None]
        if given:
            raise click.UsageError(f"--model has its own {', '.join(given)}; leave them out")
        if lux is None:
            raise click.UsageError("--model needs --lux: effects depend on the light")
        return read_model_file(file)
    missing = [names[n] for n, value in base.items() if value is None]
    if missing:
        raise click.UsageError(f"missing {', '.join(missing)}; or give a --model")
    return base_pixel({n: value for n, value in base.items() if value is not None})


def _lines(found: NoiseCalibration) -> list[str]:
    r = found.reached
    lines = [
        f"noise rms: {found.rms:.5f} +/- {found.rms_error:.5f} ln, for {found.target_hz:g} Hz per pixel",
        f"counted again with it: {r.rate_hz:.4g} Hz ({r.low_hz:.4g} to {r.high_hz:.4g}, 90 %), {r.events} events",
        f"one per cent of rms is {found.slope:.1f} +/- {found.slope_error:.1f} per cent of rate",
        f"found from {found.events} events of {found.pixels} pixels: {len(found.counted)} recordings, "
        f"{found.seconds:.4g} s each, {found.wait_s:.4g} s after the reset; it took {found.took_s:.1f} s",
    ]
    if found.matrix_rms is not None:
        lines.append(
            f"the transition matrix on the same samples, without drawing anything, gives {found.matrix_rms:.5f} ln"
        )
    return lines + [f"warning: {w}" for w in found.warnings]


def _save(found: NoiseCalibration, out: Path) -> None:
    import json

    from bench.report.figures import noise_calibration as figure
    from bench.report.figures.style import house_style
    from bench.report.saving import save_figure

    (out / "noise.json").write_text(json.dumps(found.to_dict(), indent=2) + "\n", encoding="utf-8")
    with house_style():
        save_figure(figure.draw(found), out, "noise")
    say(f"figure and numbers are in {out}")
