"""The dead time at each offset, as the camera itself reads it back."""

from __future__ import annotations

import math
from statistics import fmean, pstdev
from typing import TYPE_CHECKING, Any, Final

from bench.bias_calibration.table import BiasTable, Row, make_table
from bench.station.assembly import bias_map_of
from bench.station.schema import BiasMapSection
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from bench.store.data import PointData

__all__ = ["dead_time_table"]

_STEP_S: Final = 1e-6  #: sensors read the dead time back in whole microseconds


def dead_time_table(bias: str, points: Sequence[PointData], station: Mapping[str, Any]) -> BiasTable:
    """Return the dead time against the offset of its bias.

    Its error is the scatter of the points at one offset, and no less than the rounding to a microsecond.

    Parameters
    ----------
    points
        Those at which the bias was swept.
    station
        What the run says of its station. A camera that cannot measure its dead time leaves the value of the station's
        own bias map in the points: on a bench that is not simulated, values that are all exactly the map's are none.
    """
    read: dict[int, list[float]] = {}
    for point in points:
        if point.refractory_s > 0.0:
            read.setdefault(round(point.bias[bias]), []).append(point.refractory_s)
    if len({round(p.bias[bias]) for p in points}) < 2:
        return make_table(
            "refractory_s", bias, [], [f"refractory_s: the run has no points at several offsets of {bias}"]
        )
    if not read:
        return make_table("refractory_s", bias, [], ["refractory_s: the camera does not read its dead time back"])
    if _is_the_map(read, station):
        said = "refractory_s: all values are those of the station's own bias map: the camera did not measure them"
        return make_table("refractory_s", bias, [], [said])
    rows = []
    for offset, values in sorted(read.items()):
        mean = fmean(values)
        sd_s = math.hypot(pstdev(values), _STEP_S / math.sqrt(12.0))
        rows.append(Row(offset, mean, sd_s / mean))
    return make_table("refractory_s", bias, rows)


def _is_the_map(read: Mapping[int, Sequence[float]], station: Mapping[str, Any]) -> bool:
    if station.get("world") or station.get("sealed_world") or "calibration" not in station:
        return False
    section = station["calibration"].get("bias_map") or {}
    known = bias_map_of(BiasMapSection.model_validate(section))
    try:
        curve = known.curve("refractory_s")
        return all(value == curve.value_at(offset) for offset, values in read.items() for value in values)
    except InputError:
        return False
