"""`evs-bench events`: what is in a recording."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from bench.commands.common import json_option, print_json, print_table

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers.events.summary import Summary
    from drivers.events.types import EventChunk

__all__ = ["command"]

_SCHEMA: Final = "evs-bench-events/1"
_HDF5_SIGNATURE: Final = b"\x89HDF\r\n\x1a\n"
_POINT_CHUNK: Final = 1_000_000

_WORD_TYPES: Final = {
    "EVT3": {
        0x0: "ADDR_Y",
        0x2: "ADDR_X",
        0x3: "VECT_BASE_X",
        0x4: "VECT_12",
        0x5: "VECT_8",
        0x6: "TIME_LOW",
        0x7: "CONTINUED_4",
        0x8: "TIME_HIGH",
        0xA: "EXT_TRIGGER",
        0xD: "IMU",
        0xE: "OTHERS",
        0xF: "CONTINUED_12",
    },
    "EVT2": {0x0: "CD_OFF", 0x1: "CD_ON", 0x8: "TIME_HIGH", 0xA: "EXT_TRIGGER", 0xE: "OTHERS", 0xF: "CONTINUED"},
}


def _size(ctx: click.Context, param: click.Parameter, value: str | None) -> tuple[int, int] | None:
    """Read a sensor size such as 1280x720."""
    if value is None:
        return None
    match = re.fullmatch(r"(\d{1,5})x(\d{1,5})", value, re.ASCII)
    if match is None:
        raise click.BadParameter(f"{value!r} is not a size; expected something like 1280x720", ctx, param)
    return int(match[1]), int(match[2])


@click.command(name="events")
@click.argument("file", type=click.Path(path_type=Path))
@json_option
@click.option("--format", "format_name", metavar="NAME", help="EVT3, EVT2.1, EVT2.1-legacy, EVT2 or DAT.")
@click.option("--size", callback=_size, metavar="WxH", help="Size of the sensor, such as 1280x720.")
@click.option("--chunk", "chunk_bytes", type=click.IntRange(min=1), metavar="BYTES", help="Read so much at once.")
def command(
    file: Path, as_json: bool, format_name: str | None, size: tuple[int, int] | None, chunk_bytes: int | None
) -> None:
    """Say what is in the recording FILE.

    FILE is a RAW or DAT file, a file of bare words (.evt3, .evt21, .evt2), or a measurement point (.h5).
    """
    if not _is_hdf5(file):
        summary = _summary_of_stream(file, format_name, size, chunk_bytes)
    elif format_name or size or chunk_bytes:
        raise click.UsageError("--format, --size and --chunk do not apply to a measurement point")
    else:
        summary = _summary_of_point(file)
    if as_json:
        print_json({"schema": _SCHEMA, **summary.to_dict()})
    else:
        _print(file, summary)


def _is_hdf5(file: Path) -> bool:
    try:
        with file.open("rb") as opened:
            return opened.read(len(_HDF5_SIGNATURE)) == _HDF5_SIGNATURE
    except OSError:
        return False  # whoever reads it next says why it cannot be read


def _summary_of_stream(
    file: Path, format_name: str | None, size: tuple[int, int] | None, chunk_bytes: int | None
) -> Summary:
    from drivers.events.raw import CHUNK_BYTES
    from drivers.events.summary import summarise

    width, height = size or (None, None)
    return summarise(file, format=format_name, width=width, height=height, chunk_bytes=chunk_bytes or CHUNK_BYTES)


def _summary_of_point(file: Path) -> Summary:
    """Count what is in a measurement point. It keeps neither words nor the channels of its triggers."""
    import h5py

    from drivers.events.summary import Summary, sensor_size, sha256_of, tally
    from protocols.errors import InputError, Problem

    try:
        with h5py.File(file, "r") as opened:
            counts = tally(_chunks_of_point(opened))
            format_name = str(opened.attrs.get("format", "HDF5"))
    except (OSError, KeyError, ValueError) as error:
        message = f"is no measurement point that can be read: {error}"
        raise InputError(Problem(" ".join(message.split()), str(file))) from None
    counts.trigger_ids.clear()
    sensor, sensor_from = sensor_size(counts, None, None, "file")
    return Summary(format_name, sensor, sensor_from, counts, (), sha256_of(file))


def _chunks_of_point(opened: Any) -> Iterator[EventChunk]:
    """Yield the events of an open measurement point, and then its triggers."""
    import numpy as np

    from drivers.events.types import EVENT_DTYPE, TRIGGER_DTYPE, EventChunk, empty_events, empty_triggers

    columns = {name: opened[f"events/{name}"] for name in ("t", "x", "y", "p")}
    for start in range(0, len(columns["t"]), _POINT_CHUNK):
        part = {name: column[start : start + _POINT_CHUNK] for name, column in columns.items()}
        events = np.empty(len(part["t"]), EVENT_DTYPE)
        for name, values in part.items():
            events[name] = values
        yield EventChunk(events, empty_triggers())
    if "triggers/t" in opened:
        triggers = np.zeros(len(opened["triggers/t"]), TRIGGER_DTYPE)
        triggers["t"], triggers["p"] = opened["triggers/t"][()], opened["triggers/p"][()]
        yield EventChunk(empty_events(), triggers)


def _print(file: Path, summary: Summary) -> None:
    rows = [("file", str(file)), ("format", summary.format), ("sensor", _sensor(summary)), *_counts(summary)]
    rows += [("header", line) for line in summary.header]
    if summary.word_types is not None:
        rows += [("words", _words(summary, kind, n)) for kind, n in summary.word_types.items()]
    if summary.erc and summary.erc["n_before"] + summary.erc["n_after"]:
        rows.append(("rate controller", f"{summary.erc['before']} events in, {summary.erc['after']} out"))
    if summary.violations is not None:
        broken = [(f"violations {name}", str(n)) for name, n in summary.violations.items() if n]
        rows += broken or [("violations", "none")]
    print_table(("what", "value"), [*rows, ("sha256", summary.sha256)])


def _sensor(summary: Summary) -> str:
    if summary.sensor is None:
        return "unknown"
    note = " (smallest that holds all events; the file does not say)" if summary.sensor_from == "events" else ""
    return f"{summary.sensor[0]} x {summary.sensor[1]} pixels{note}"


def _counts(summary: Summary) -> list[tuple[str, str]]:
    counts = summary.tally
    rates = {name: "" if rate is None else f", {rate:.6g} per s" for name, rate in counts.rates_hz().items()}
    rows = [
        ("events", f"{counts.n_cd}{rates['cd']}"),
        ("events ON", f"{counts.n_on}{rates['on']}"),
        ("events OFF", f"{counts.n_off}{rates['off']}"),
    ]
    if counts.t_first is not None and counts.t_last is not None:
        rows += [
            ("first and last event", f"{counts.t_first} and {counts.t_last} us"),
            ("earliest and latest", f"{counts.t_min} and {counts.t_max} us"),
            ("steps back in time", str(counts.n_backward_steps)),
            ("largest x and y", f"{counts.x_max} and {counts.y_max}"),
        ]
    channels = f", channels {', '.join(map(str, counts.trigger_ids))}" if counts.trigger_ids else ""
    rising = f", {counts.trigger_rising} rising" if counts.n_trigger else ""
    return [
        *rows,
        ("triggers", f"{counts.n_trigger}{rates['trigger'] if counts.n_trigger else ''}{rising}{channels}"),
    ]


def _words(summary: Summary, kind: int, n: int) -> str:
    names = _WORD_TYPES["EVT3" if summary.format.startswith("EVT3") else "EVT2"]
    return f"{n} {names.get(kind, f'reserved 0x{kind:X}')}"
