"""Making a run of recordings that were made elsewhere."""

from __future__ import annotations

import logging
import os
import shutil
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench.alignment.counts import EventCounts
from bench.alignment.events import align_to_events
from bench.alignment.triggers import align_to_triggers, moved_windows
from bench.importing.point_file import carried_over, shift_s
from bench.importing.schema import PointSection, RecordingsFile
from bench.importing.stimulus import Light, light_of
from bench.importing.stream import Source, open_source, rebased
from bench.logs import LOG_FILE, log_into
from bench.run.runner import new_run_id
from bench.run.software import software_versions
from bench.store.durable import sync_folder
from bench.store.errors import RunError
from bench.store.layout import PART_SUFFIX
from bench.store.point_writer import cannot_write
from bench.store.record import PointRecord, PulseRecord, StimulusRecord
from bench.store.writer import RunWriter
from protocols.errors import InputError
from protocols.files import read_model

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.store.point_writer import PointWriter

__all__ = ["RECORDINGS_FILE", "import_folder"]

_log = logging.getLogger("evs_bench.importing")
RECORDINGS_FILE: Final = "recordings.yaml"

_KEPT: Final = ("protocol", "protocol_text", "station", "software")
_ATTRIBUTES: Final = (
    "measurement",
    "started",
    "ambient",
    "nd_id",
    "nd_transmission",
    "bench_lux_before",
    "bench_lux_after",
)


def import_folder(folder: Path | str, out: Path | str) -> Path:
    """Make the run `out` of the recordings in `folder`, which ``recordings.yaml`` there describes.

    Recordings are read as streams, in memory that does not grow with them, apart from the triggers and a count of
    events for each 50 us. The run appears when it is complete; an error leaves nothing behind.

    Raises
    ------
    InputError
        All that is wrong with ``recordings.yaml``, or with the recordings that it names.
    RunError
        If `out` exists or cannot be written.
    """
    folder, out = Path(folder), Path(out)
    where = folder / RECORDINGS_FILE
    file = read_model(where, RecordingsFile)
    sources = _open_all(folder, file, where)
    if out.exists():
        raise RunError(f"{out}: exists already, and a run never overwrites; choose another name")
    part = out.with_name(f".{out.name}.{os.getpid()}{PART_SUFFIX}")
    try:
        with RunWriter(part, _header(file)) as writer, log_into(part / LOG_FILE):
            writer.note("run_started", points=len(sources))
            for index, (section, source) in enumerate(zip(file.points, sources, strict=True)):
                _take(index, section, source, file, writer)
            writer.note("run_finished")
        _rename(part, out)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return out


def _open_all(folder: Path, file: RecordingsFile, where: Path) -> list[Source]:
    """Return all recordings, not read yet; or raise with all that cannot be opened."""
    sources, problems = [], []
    for number, section in enumerate(file.points):
        try:
            sources.append(open_source(folder, section, file))
        except InputError as error:
            problems += [f"{where}: points.{number}: {problem}" for problem in error.problems]
    if problems:
        raise InputError(*problems)
    return sources


def _rename(part: Path, out: Path) -> None:
    try:
        part.rename(out)
        sync_folder(out.parent)
    except OSError as error:
        raise cannot_write(out, error) from error


def _header(file: RecordingsFile) -> dict[str, Any]:
    """Return the keys of ``run.yaml``."""
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    header: dict[str, Any] = {
        "id": file.id or new_run_id(file.title or "import"),
        "created": file.created or now,
        "title": file.title,
        "sensor": file.sensor.model_dump(exclude_none=True),
        "roi": file.roi.model_dump(),
    }
    header |= {key: getattr(file, key) for key in _KEPT if getattr(file, key) is not None}
    return header | {"imported": {"at": now, "by": software_versions()}}


def _take(index: int, section: PointSection, source: Source, file: RecordingsFile, writer: RunWriter) -> None:
    """Write one point."""
    roi = (section.roi or file.roi).to_roi()
    writer.note("started", index)
    with writer.point(index) as point:
        found = _read_through(source, section, point, roi)
        if found.duration_s <= 0.0:
            raise InputError(f"{source.path}: holds no event and no trigger in its time window; give its duration_s")
        record = _record(index, section, source, found)
        writer.finish(point, replace(record, roi=None if section.roi is None else roi))


@dataclass(slots=True)
class _Found:
    """What is known of a recording after it was read through."""

    duration_s: float = 0.0
    counts: EventCounts = field(default_factory=EventCounts)
    trigger_t_us: npt.NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    trigger_p: npt.NDArray[np.uint8] = field(default_factory=lambda: np.empty(0, np.uint8))


def _read_through(source: Source, section: PointSection, point: PointWriter, roi: Any) -> _Found:
    """Pass the events to the point file, and keep what tells the time axis."""
    found, t, p = _Found(), [np.empty(0, np.int64)], [np.empty(0, np.uint8)]
    for chunk in rebased(source, section, roi):
        point.append(chunk)
        t.append(chunk.triggers["t"])
        p.append(chunk.triggers["p"])
        if section.align == "from_events":
            found.counts.add(chunk.events["t"], chunk.events["p"])
    found.trigger_t_us, found.trigger_p = np.concatenate(t), np.concatenate(p)
    found.duration_s = _duration_s(section, source)
    return found


def _duration_s(section: PointSection, source: Source) -> float:
    """Return the length of what was taken, s; what is said of it must not be longer than what was recorded."""
    known_s = section.duration_s
    if known_s is None and source.point is not None:
        known_s = source.point.duration_s - (section.start_us or 0) / 1e6
    if section.time_window_s is not None:
        begin_s, end_s = section.time_window_s
        recorded_s = source.end_us / 1e6 if known_s is None else known_s
        if end_s > recorded_s:
            raise InputError(
                f"{source.path}: time_window_s ends at {end_s:g} s, but the recording ends at {recorded_s:g} s; if "
                "it was longer, and only its last events came earlier, say how long in duration_s"
            )
        return end_s - begin_s
    return source.last_us / 1e6 if known_s is None else known_s


def _record(index: int, section: PointSection, source: Source, found: _Found) -> PointRecord:
    light = light_of(section)
    quality: dict[str, Any] = dict(source.quality())
    stimulus, pulses, more = _placed(section, light, source, found, quality)
    for name in ("backward", "outside_roi", "after_end", "edges_without_trigger", "windows_outside"):
        if quality.get(name):
            _log.warning("%s: %s: %d", source.path, name.replace("_", " "), quality[name])
    known = {name: getattr(section, name) for name in _ATTRIBUTES}
    record = PointRecord(
        index=index,
        waveform=section.waveform,
        polarity=section.polarity,
        baseline_lux=light.baseline_lux,
        log_contrast=light.log_contrast,
        duration_s=found.duration_s,
        nd_od=section.nd_od,
        stimulus=stimulus,
        pulses=pulses,
        refractory_s=float("nan") if section.refractory_s is None else section.refractory_s,
        temperature_c=float("nan") if section.temperature_c is None else section.temperature_c,
        attributes={**known, "reset_log_contrast": light.reset_log_contrast, "source_file": section.file, **more},
        bias=dict(section.bias),
        quality=quality,
    )
    return record if source.point is None else carried_over(record, source.point, shift_s(section))


def _placed(
    section: PointSection, light: Light, source: Source, found: _Found, quality: dict[str, Any]
) -> tuple[StimulusRecord, PulseRecord, dict[str, Any]]:
    """Return stimulus and windows on the time axis of the recording, and the attributes that say how."""
    t_s, trigger, more = _aligned(section, light, source, found, quality)
    start, stop = moved_windows(light.stimulus, t_s)
    inside = (start >= 0.0) & (stop <= found.duration_s)
    quality |= {"windows_outside": int((~inside).sum())} if not inside.all() else {}
    keep = (t_s <= found.duration_s) & (t_s >= 0.0)
    if not keep[1:].all():
        raise InputError(
            f"{source.path}: the stimulus lasts from {t_s[1]:.4g} to {t_s[-1]:.4g} s, "
            f"the recording from 0 to {found.duration_s:.4g} s"
        )
    pulses = PulseRecord(start, stop, light.stimulus.pulse_kind, inside.astype(np.uint8))
    return StimulusRecord(t_s, light.stimulus.lux, trigger), pulses, {"time_axis": section.align, **more}


def _aligned(
    section: PointSection, light: Light, source: Source, found: _Found, quality: dict[str, Any]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64] | None, dict[str, Any]]:
    edges_s = light.stimulus.t_s
    if section.align == "edges_known":
        return edges_s.copy(), None, {}
    if section.align == "trigger":
        fit = align_to_triggers(edges_s, found.trigger_t_us, found.trigger_p)
        if fit is None:
            raise InputError(f"{source.path}: none of its {len(found.trigger_t_us)} triggers fits the stimulus")
        quality |= {"edges_without_trigger": fit.lost, "triggers_without_edge": fit.extra}
        return fit.t_s, fit.trigger, fit.attributes()
    limits_s = (-float(edges_s[:2][-1]), found.duration_s - float(edges_s[-1]))  # all edges are in the recording
    if limits_s[1] < limits_s[0]:
        raise InputError(f"{source.path}: the stimulus is longer than the recording of {found.duration_s:.4g} s")
    place = align_to_events(
        edges_s, light.stimulus.lux, found.counts, duration_s=found.duration_s, offset_limits_s=limits_s
    )
    if place is None:
        raise InputError(f"{source.path}: no events answer the stimulus, so they do not tell when it began")
    if place.doubtful:
        _log.warning("%s: when the stimulus began is doubtful: %s", source.path, "; ".join(place.doubts))
    quality |= place.quality()
    return place.t_s, None, place.attributes()
