"""What a point file says of its data beside events and stimulus, carried over to the point that is made of it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench.store import layout
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bench.importing.schema import PointSection
    from bench.store.data import PointData
    from bench.store.record import PointRecord

__all__ = ["carried_over", "quality_of", "refuse_what_is_lost", "shift_s"]

#: Attributes that the new point says itself: of its stimulus and its time axis.
_NEW: Final = ("format", "index", "waveform", "polarity", "baseline_lux", "log_contrast", "duration_s", "nd_od")
_NEW_STARTS: Final = ("roi_", "time_", "reset_log_contrast")


def shift_s(section: PointSection) -> float:
    """Return what time of a point file becomes 0, s."""
    begin_s = 0.0 if section.time_window_s is None else section.time_window_s[0]
    return (section.start_us or 0) / 1e6 + begin_s


def refuse_what_is_lost(point: PointData) -> None:
    """Raise InputError if the file marks its data in a way that cannot be carried over."""
    import h5py

    contrasts = point.pulse_log_contrast
    if contrasts.size and not np.allclose(contrasts, contrasts[0]):
        raise InputError(f"{point.path}: /pulses/log_contrast differs between pulses, which an import cannot keep")
    with h5py.File(point.path, "r") as file:
        found = {f"{group}/{name}" for group in ("quality", "pixels") if group in file for name in file[group]}
    lost = sorted(found - {layout.GAPS.path, layout.MASKED.path})
    if lost:
        raise InputError(f"{point.path}: /{', /'.join(lost)}: an import cannot keep this mark of the data")


def quality_of(point: PointData, counts: Mapping[str, int]) -> dict[str, Any]:
    """Return the quality that the file told, with what was left out now added to it."""
    added = {name: n for name, n in counts.items() if n}
    before = {name: point.quality.get(name, 0) for name in added}
    sums = {name: n + before[name] if isinstance(before[name], int) else n for name, n in added.items()}
    return {**point.quality, **sums}


def carried_over(record: PointRecord, point: PointData, shift_s: float) -> PointRecord:
    """Return `record` with gaps, masked pixels, biases, marked windows and attributes of `point`.

    Times move by `shift_s` and are cut to the duration of `record`. What the description says itself goes first.
    """
    told = {name: value for name, value in record.attributes.items() if value is not None}
    old = {k: v for k, v in point.attributes.items() if k not in _NEW and not k.startswith(_NEW_STARTS)}
    unknown_refractory, unknown_temperature = math.isnan(record.refractory_s), math.isnan(record.temperature_c)
    return replace(
        record,
        refractory_s=point.refractory_s if unknown_refractory else record.refractory_s,
        temperature_c=point.temperature_c if unknown_temperature else record.temperature_c,
        attributes={**{k: v for k, v in old.items() if k not in ("refractory_s", "temperature_c")}, **told},
        bias={**point.bias, **record.bias},
        gaps_s=_gaps_s(record, point, shift_s),
        masked=point.masked if len(point.masked) else None,
        pulses=replace(record.pulses, valid=_valid(record, point, shift_s)),
    )


def _gaps_s(record: PointRecord, point: PointData, shift_s: float) -> tuple[tuple[float, float], ...]:
    moved = np.clip(point.gaps_s - shift_s, 0.0, record.duration_s)
    return tuple((float(start), float(stop)) for start, stop in moved if stop > start)


def _valid(record: PointRecord, point: PointData, shift_s: float) -> Any:
    """Return which windows are valid: none that overlaps with a window that the file marks as not valid."""
    pulses = record.pulses
    valid = np.ones(len(pulses.start_s), np.uint8) if pulses.valid is None else pulses.valid.copy()
    bad = ~point.pulse_valid
    for start_s, stop_s in zip(point.pulse_start_s[bad] - shift_s, point.pulse_stop_s[bad] - shift_s, strict=True):
        valid[(pulses.start_s < stop_s) & (pulses.stop_s > start_s)] = 0
    return valid
