"""`evs-bench photometry meter`: readings of a lux meter become the calibration of a station's light."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bench.commands.common import json_option, print_json, say
from bench.commands.numbers import FROM_0

if TYPE_CHECKING:
    import datetime

    from bench.photometry.meter import Line, MeterCalibration, Reading
    from bench.photometry.propagation import Known
    from bench.photometry.station_light import NewLight, OfStation

__all__ = ["meter"]


@click.command()
@click.argument("readings")
@click.option("--station", metavar="FILE", help="The station: prints the YAML that belongs into it.")
@click.option("--write", is_flag=True, help="Change the station file; the old one stays beside it.")
@click.option(
    "--date", type=click.DateTime(["%Y-%m-%d"]), metavar="YYYY-MM-DD", help="When it was measured; with --station."
)
@click.option("--meter-uncertainty", type=FROM_0, metavar="REL",
              help="Of the meter: relative, one standard deviation (0.02 is 2 %).")  # fmt: skip
@click.option("--leave-out", type=click.IntRange(1), multiple=True, metavar="LINE",
              help="A line of READINGS that does not count. Can be given several times.")  # fmt: skip
@json_option
def meter(
    readings: str,
    station: str | None,
    write: bool,
    date: datetime.datetime | None,
    meter_uncertainty: float | None,
    leave_out: tuple[int, ...],
    as_json: bool,
) -> None:
    """Calibrate a station's light with READINGS of a lux meter where the chip will be.

    READINGS is a CSV file with the header level,lux or level,lux,filter: two or more readings without a filter (the
    filter is empty or `clear`), and behind each filter. Level in the unit of the source; readings at level 0 are the
    light of the room, and are subtracted.
    """
    if write and station is None:
        raise click.UsageError("--write needs --station FILE")
    if station is not None and date is None:
        raise click.UsageError("--station needs --date: when were the readings taken?")
    from bench.photometry.meter import calibrate, read_readings
    from bench.photometry.station_light import new_light, of_station
    from bench.station.rewriting import refuse_shipped

    if station is not None and write:
        refuse_shipped(station)
    known = None if station is None else of_station(station)
    taken = _named_clear(read_readings(readings), known)
    found = calibrate(taken, readings, leave_out=leave_out, meter_uncertainty=meter_uncertainty)
    new = None if known is None or date is None else new_light(found, known, date.date())
    kept = _write(Path(station), new) if write and station is not None and new is not None else None
    if as_json:
        asked = {
            "readings": readings,
            "station": station,
            "meter_uncertainty": meter_uncertainty,
            "leave_out": leave_out,
        }
        written = None if kept is None else {"station": station, "before": str(kept)}
        print_json({
            "format": "evs-bench-photometry/1", "command": "meter", "asked": asked, **_numbers(found, known),
            "calibration": _plain(new), "written": written,
        })  # fmt: skip
        return
    _print_calibration(found, known, readings)
    if new is not None and not write:
        _print_yaml(new, station)


def _named_clear(readings: list[Reading], known: OfStation | None) -> list[Reading]:
    """Return the readings with the name `clear` for those through the station's own clear position."""
    from bench.photometry.meter import CLEAR

    if known is None or known.clear_name is None:
        return readings
    return [replace(r, filter_name=CLEAR) if r.filter_name == known.clear_name else r for r in readings]


def _write(station: Path, new: NewLight) -> Path:
    from bench.photometry.station_light import write_light

    kept = write_light(station, new)
    say(f"{station} is changed; what it was is in {kept}")
    return kept


def _print_calibration(found: MeterCalibration, known: OfStation | None, source: str) -> None:
    unit = "level" if known is None else known.unit
    total = found.lux_per_level
    told = "the meter's own error is not in it" if found.meter_uncertainty is None else "with the meter's own error"
    click.echo(f"{'lux per ' + unit:<13}  {_with_error(total)} ({total.sd / total.value:.2%}; {told})")
    click.echo(f"made of        {found.clear.readings} readings without a filter{_left_out(found)}")
    for line in (found.clear, *found.filters):
        _print_ambient(line, found)
    for line in found.filters:
        transmission = found.transmission(line)
        nominal = _nominal(line, known)
        beside = "" if nominal is None else f"; nominal 10^-OD {nominal:.4g}"
        click.echo(
            f"{line.filter_name:<13}  transmission {_with_error(transmission)} "
            f"({transmission.sd / transmission.value:.2%}), {line.readings} readings{beside}"
        )
    for line in (found.clear, *found.filters):
        _print_odd(line, source)


def _left_out(found: MeterCalibration) -> str:
    return f", without line {', '.join(map(str, found.left_out))}" if found.left_out else ""


def _print_ambient(line: Line, found: MeterCalibration) -> None:
    from bench.photometry.meter import behind

    where = behind(line.filter_name)
    if line.ambient is not None:
        click.echo(f"room light     {line.ambient.value:.4g} lux {where} at level 0, subtracted there")
    elif found.clear.ambient is not None:
        click.echo(f"room light     not read {where}: nothing is subtracted there")


def _print_odd(line: Line, source: str) -> None:
    from bench.photometry.meter import behind

    for odd in line.odd:
        reading = odd.reading
        side = "below" if odd.off < 0.0 else "above"
        guess = " (a saturated meter?)" if odd.off < 0.0 else ""
        click.echo(
            f"warning: {source}:{reading.line}: {reading.lux:g} lux at level {reading.level:g} "
            f"{behind(line.filter_name)} is {abs(odd.off):.1%} {side} the line of the others, more than these "
            f"scatter{guess}; it counts unless you say --leave-out {reading.line}"
        )


def _nominal(line: Line, known: OfStation | None) -> float | None:
    return None if known is None else 10.0 ** -known.nd_od[line.filter_name]


def _with_error(known: Known) -> str:
    return f"{known.value:.5g} +- {known.sd:.2g}"


def _print_yaml(new: NewLight, station: str | None) -> None:
    from bench.photometry.station_light import yaml_text

    click.echo(f"\nbelow `calibration:` of {station} (change it with --write):\n")
    click.echo("".join(f"  {line}\n" for line in yaml_text(new).splitlines()), nl=False)


def _numbers(found: MeterCalibration, known: OfStation | None) -> dict[str, Any]:
    total = found.lux_per_level
    filters = {}
    for line in found.filters:
        transmission = found.transmission(line)
        filters[line.filter_name] = {
            "transmission": transmission.value,
            "sd": transmission.sd,
            "nominal": _nominal(line, known),
            "readings": line.readings,
            "ambient_lux": None if line.ambient is None else line.ambient.value,
        }
    return {
        "lux_per_level": total.value,
        "lux_per_level_sd": total.sd,
        "readings": found.clear.readings,
        "ambient_lux": None if found.clear.ambient is None else found.clear.ambient.value,
        "filters": filters,
        "odd_lines": [
            {"line": odd.reading.line, "off": odd.off} for line in (found.clear, *found.filters) for odd in line.odd
        ],
    }


def _plain(new: NewLight | None) -> dict[str, Any] | None:
    """Return what belongs below `calibration`, with dates as text."""
    if new is None:
        return None

    def texts(values: dict[str, Any]) -> dict[str, Any]:
        return {key: str(value) if key == "date" else value for key, value in values.items()}

    return {"light": texts(new.light), "filters": {name: texts(values) for name, values in new.filters.items()}}
