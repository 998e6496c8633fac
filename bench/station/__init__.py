"""The station: which driver plays which role, with its arguments and its calibration.

:func:`load_station` is all that the rest of the bench needs. The names below are loaded when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bench.station.bias_map import BiasMap
    from bench.station.calibration import Calibration
    from bench.station.loading import load_station, station_from, stations
    from bench.station.station import DevicesFailed, Station

__all__ = ["BiasMap", "Calibration", "DevicesFailed", "Station", "load_station", "station_from", "stations"]

_HOME = {
    "BiasMap": "bench.station.bias_map",
    "Calibration": "bench.station.calibration",
    "DevicesFailed": "bench.station.station",
    "Station": "bench.station.station",
    "load_station": "bench.station.loading",
    "station_from": "bench.station.loading",
    "stations": "bench.station.loading",
}


def __getattr__(name: str) -> Any:
    """Load a public name from the module that defines it."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
