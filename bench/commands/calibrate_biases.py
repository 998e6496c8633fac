"""`evs-bench calibrate-biases`: a run becomes the bias map of a station."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bench.commands.common import json_option, print_json, print_table, say
from bench.commands.numbers import ABOVE_0

if TYPE_CHECKING:
    from bench.bias_calibration import BiasCalibration
    from bench.bias_calibration.quiet import Tuning
    from bench.bias_calibration.station_map import NewBiasMap
    from bench.bias_calibration.table import BiasTable

__all__ = ["command"]

_TITLES = {
    "theta_on": "ON threshold",
    "theta_off": "OFF threshold",
    "refractory_s": "dead time",
    "bandwidth_hz": "corner of the source follower",
}


@click.command(name="calibrate-biases")
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--station", metavar="FILE", help="The station: its names of the biases, its light, its scales.")
@click.option("--write", is_flag=True, help="Change the station file; the old one stays beside it.")
@click.option(
    "--date",
    type=click.DateTime(["%Y-%m-%d"]),
    metavar="YYYY-MM-DD",
    help="Of the calibration; default is the run's.",
)
@click.option("--target-background", "target_hz", type=ABOVE_0, metavar="HZ",
              help="Find the lowest thresholds with at most so many noise events per pixel and second.")  # fmt: skip
@json_option
def command(
    run: Path,
    station: str | None,
    write: bool,
    date: datetime.datetime | None,
    target_hz: float | None,
    as_json: bool,
) -> None:
    """Make the bias map of a station of RUN, a run of the protocol bias_calibration or one like it.

    For each bias a table of offsets and values with 90 % intervals: thresholds from the S-curves, the corner from
    their latencies, the dead time as the camera reads it back. Rows out of order are dropped where their errors
    allow, and else pointed out.

    Example:  evs-bench calibrate-biases my_run --station bench.yaml --target-background 0.1
    """
    if write and station is None:
        raise click.UsageError("--write needs --station FILE")
    from bench.bias_calibration import calibrate_biases
    from bench.bias_calibration.station_map import new_bias_map, of_station, write_bias_map
    from bench.station.rewriting import refuse_shipped
    from bench.store import Run

    if station is not None and write:
        refuse_shipped(station)
    known = None if station is None else of_station(station)
    found = calibrate_biases(
        Run.open(run).without_damaged(),
        biases=None if known is None else known.biases,
        light_edge_s=None if known is None else known.light_edge_s,
        target_hz=target_hz,
        tell=say,
    )
    new = new_bias_map(found, known, _date(date, found))
    kept = write_bias_map(Path(station), new) if write and station is not None else None
    remarks = [*found.remarks]
    if known is not None and known.map_is_the_truth:
        remarks.append(
            "bias_map: in this simulated station the biases do what the bias map says, right or wrong; give its "
            "world a bias_map of its own to keep the two apart"
        )
    if as_json:
        written = None if kept is None else {"station": station, "before": str(kept)}
        print_json({**found.to_dict(), "remarks": remarks, "bias_map": _plain(new), "written": written})
        return
    _print(found, target_hz, remarks)
    if kept is None:
        _print_yaml(new, station)
    else:
        say(f"{station} is changed; what it was is in {kept}")


def _date(given: datetime.datetime | None, found: BiasCalibration) -> datetime.date:
    """Return the day of the calibration: as given, or that of the run."""
    if given is not None:
        return given.date()
    try:
        return datetime.date.fromisoformat(found.created[:10])
    except ValueError:
        raise click.UsageError("the run does not say when it was taken; give --date") from None


def _print(found: BiasCalibration, target_hz: float | None, remarks: list[str]) -> None:
    for table in found.tables:
        if table.rows:
            _print_curve(table)
    if found.rates:
        _print_rates(found)
    if target_hz is not None and found.tuning is not None:
        _print_tuning(found.tuning, found.rate_biases)
    for remark in remarks:
        click.echo(f"warning: {remark}")


def _print_curve(table: BiasTable) -> None:
    estimates = [row.estimate(table.quantity) for row in table.rows]
    unit = estimates[0].unit
    click.echo(f"{_TITLES[table.quantity]}, {table.quantity}" + ("" if table.usable else " (no curve)"))
    rows = [
        [str(row.offset), f"{e.value:.4g}", f"{e.low:.4g}", f"{e.high:.4g}", row.note]
        for row, e in zip(table.rows, estimates, strict=True)
    ]
    print_table([table.bias, unit, "low", "high", ""], rows)
    click.echo("")


def _print_rates(found: BiasCalibration) -> None:
    click.echo("background, ON and OFF together")
    rows = [
        [str(r.on_offset), str(r.off_offset), f"{r.rate.value:.3g}", f"{r.rate.low:.3g}", f"{r.rate.high:.3g}"]
        for r in found.rates
    ]
    print_table([*found.rate_biases, "Hz", "low", "high"], rows)
    click.echo("")


def _print_tuning(tuning: Tuning, biases: tuple[str, str]) -> None:
    rate = tuning.rate
    click.echo(
        f"at most {tuning.target_hz:g} Hz: {biases[0]} {tuning.on_offset}, {biases[1]} {tuning.off_offset}: "
        f"thresholds of {tuning.theta_on:.4g} and {tuning.theta_off:.4g} ln, {rate.value:.3g} Hz ({rate.low:.3g} to "
        f"{rate.high:.3g})" + (f"; {tuning.note}" if tuning.note else "")
    )


def _print_yaml(new: NewBiasMap, station: str | None) -> None:
    from bench.bias_calibration.station_map import yaml_text

    where = "of a station file" if station is None else f"of {station} (change it with --write)"
    click.echo(f"\nbelow `calibration:` {where}:\n")
    click.echo("".join(f"  {line}\n" for line in yaml_text(new).splitlines()), nl=False)


def _plain(new: NewBiasMap) -> dict[str, Any]:
    """Return the new sections with dates as text."""
    return {
        quantity: {key: str(value) if key == "date" else value for key, value in values.items()}
        for quantity, values in new.curves.items()
    }
