"""The names of the run format, version 1: files, attributes and datasets with their types and units."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from bench.store.errors import RunError

__all__ = [
    "CONTROL_FILE",
    "FROM_EVENTS",
    "JOURNAL_FILE",
    "PART_SUFFIX",
    "POINTS_FOLDER",
    "POINT_FORMAT",
    "REQUIRED",
    "RUN_FILE",
    "RUN_FORMAT",
    "Dataset",
    "check_format",
    "point_file",
    "point_of",
]

RUN_FORMAT: Final = "evs-bench-run/1"
POINT_FORMAT: Final = "evs-bench-point/1"
RUN_FILE: Final = "run.yaml"
JOURNAL_FILE: Final = "journal.jsonl"
POINTS_FOLDER: Final = "points"
PART_SUFFIX: Final = ".part"
FROM_EVENTS: Final = "from_events"  #: a `time_axis` that the events themselves told
CONTROL_FILE: Final = "control.json"  #: what the operator wishes, from another terminal; gone when it was heard

_POINT_FILE: Final = re.compile(r"(?P<index>[0-9]{6,})(\.r(?P<repeat>[1-9][0-9]*))?\.h5")


def point_file(index: int, repeat: int = 0) -> str:
    """Return the name of the file of a point: of its first file, or of a further one, ``000012.r1.h5``."""
    return f"{index:06d}{f'.r{repeat}' if repeat else ''}.h5"


def point_of(name: str) -> tuple[int, int] | None:
    """Return the point and the number of its file by the name of the file; None if it is none of a point."""
    match = _POINT_FILE.fullmatch(name)
    return None if match is None else (int(match["index"]), int(match["repeat"] or 0))


@dataclass(frozen=True, slots=True)
class Dataset:
    """What the format says of one dataset. `shape` has None where the length is free."""

    path: str
    dtype: str
    units: tuple[str, ...]  #: accepted units; the first is what is written
    columns: int = 0  #: 0 for a vector, else the number of columns


# The format fixes no spelling of the units: what other tools write for the same unit is read too. The Greek mu and
# the sign for micro are different characters.
_US: Final = ("us", "\u00b5s", "\u03bcs", "usec", "microsecond", "microseconds")
_S: Final = ("s", "sec", "second", "seconds")
_LUX: Final = ("lux", "lx")
_PIXEL: Final = ("pixel", "pixels", "px")
_ONE: Final = ("1", "", "dimensionless")

EVENT_DATASETS: Final = (
    Dataset("events/t", "int64", _US),
    Dataset("events/x", "uint16", _PIXEL),
    Dataset("events/y", "uint16", _PIXEL),
    Dataset("events/p", "uint8", _ONE),
)
STIMULUS_T: Final = Dataset("stimulus/t", "float64", _S)
STIMULUS_LUX: Final = Dataset("stimulus/illuminance", "float64", _LUX)
STIMULUS_TRIGGER: Final = Dataset("stimulus/trigger", "int64", _ONE)
PULSE_START: Final = Dataset("pulses/start", "float64", _S)
PULSE_STOP: Final = Dataset("pulses/stop", "float64", _S)
PULSE_KIND: Final = Dataset("pulses/kind", "uint8", _ONE)
PULSE_VALID: Final = Dataset("pulses/valid", "uint8", _ONE)
PULSE_CONTRAST: Final = Dataset("pulses/log_contrast", "float64", (*_ONE, "ln"))
TRIGGER_T: Final = Dataset("triggers/t", "int64", _US)
TRIGGER_P: Final = Dataset("triggers/p", "uint8", _ONE)
GAPS: Final = Dataset("quality/gaps", "float64", _S, columns=2)
MASKED: Final = Dataset("pixels/masked", "uint16", _PIXEL, columns=2)

REQUIRED: Final = (
    *EVENT_DATASETS,
    STIMULUS_T,
    STIMULUS_LUX,
    PULSE_START,
    PULSE_STOP,
    PULSE_KIND,
    TRIGGER_T,
    TRIGGER_P,
)

_FORMAT = re.compile(r"(?P<name>[a-z-]+)/(?P<number>[0-9]+)")


def check_format(found: object, expected: str, where: str) -> None:
    """Raise :class:`RunError` unless `found` is the format `expected`, or an older number of it."""
    match = _FORMAT.fullmatch(found) if isinstance(found, str) else None
    name, number = expected.split("/")
    if match is None or match["name"] != name:
        raise RunError(f"{where}: format is {found!r}, expected {expected!r}")
    if int(match["number"]) > int(number):
        raise RunError(
            f"{where}: format {found} is newer than this version of the bench reads ({expected}): update it"
        )
