"""The events of a recording on the time axis of a run: 0 at its start, in its window of pixels, never going back."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.importing.point_file import quality_of, refuse_what_is_lost
from bench.store.event_reader import read_events
from bench.store.probe import probe
from bench.store.reader import read_point
from drivers.events.raw import Recording, open_recording
from drivers.events.types import TRIGGER_DTYPE, EventChunk, empty_events, empty_triggers
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from bench.importing.schema import PointSection, RecordingsFile
    from bench.store.data import PointData
    from protocols.points import Roi

__all__ = ["Source", "open_source", "rebased"]

_US_PER_S = 1_000_000
_HDF5 = (".h5", ".hdf5")


@dataclass(slots=True)
class Source:
    """A recording, and what was found and left out while it was read."""

    path: Path
    chunks: Iterator[EventChunk]
    counts: Counter[str] = field(default_factory=Counter)  #: becomes the attributes of `/quality`
    last_us: int = 0  #: latest event or trigger, on the new time axis
    end_us: int = 0  #: latest event or trigger, cut or not, since the start of the recording
    recording: Recording | None = None  #: None for a point file
    point: PointData | None = None  #: what a point file says

    def quality(self) -> dict[str, Any]:
        """Return what is known of the completeness of the recording, once it was read to its end."""
        if self.point is not None:
            return quality_of(self.point, self.counts)
        violations = self.recording.violations if self.recording else {}
        broken = {f"violation_{name}".replace(" ", "_"): n for name, n in violations.items() if n}
        return (
            {"decode_errors": sum(violations.values()), "bytes_received": self.path.stat().st_size}
            | broken
            | {name: n for name, n in self.counts.items() if n}
        )


def open_source(folder: Path, section: PointSection, file: RecordingsFile) -> Source:
    """Return the recording of one point, not read yet.

    Raises
    ------
    InputError
        If it is not there or not within `folder`, or its format is not known.
    """
    path = folder / section.file
    if Path(section.file).is_absolute() or not path.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{section.file}: leads outside the folder of the recordings; copy the recording into it")
    if path.suffix.lower() in _HDF5:
        probe([path])
        point = read_point(path, file.roi.to_roi())
        refuse_what_is_lost(point)
        return Source(path, _of_point_file(point), point=point)
    # The header of a recording knows the size of its sensor; a file of bare words is told it.
    recording = open_recording(path, format=section.format)
    if recording.width is None:
        recording = open_recording(
            path, format=section.format, width=file.sensor.width, height=file.sensor.height
        )  # fmt: skip
    return Source(path, recording.chunks(), recording=recording)


def _of_point_file(point: PointData) -> Iterator[EventChunk]:
    triggers = np.zeros(len(point.triggers_t_us), TRIGGER_DTYPE)
    triggers["t"], triggers["p"] = point.triggers_t_us, point.triggers_p
    yield EventChunk(empty_events(), triggers)
    for events in read_events(point.path):
        yield EventChunk(events, empty_triggers())


def rebased(source: Source, section: PointSection, roi: Roi) -> Iterator[EventChunk]:
    """Yield the stream of `source` as it is stored: times from 0, inside window and time window, in order of time.

    What is left out is counted in `source.counts`: `before_start` and `after_end` (of the time window or the
    recording), `outside_roi`, and `backward` (events or triggers earlier than one that came before them).
    """
    start_us = 0 if source.recording is None and section.start_us is None else section.start_us
    begin_us, end_us = 0, None if section.duration_s is None else round(section.duration_s * _US_PER_S)
    if section.time_window_s is not None:
        begin_us, end_us = (round(t * _US_PER_S) for t in section.time_window_s)
    latest = {"events": 0, "triggers": 0}
    for chunk in source.chunks:
        if start_us is None:
            start_us = _first_us(chunk)
        zero_us = start_us + begin_us
        ends_us = [int(part["t"].max()) for part in (chunk.events, chunk.triggers) if len(part)]
        source.end_us = max(source.end_us, max(ends_us, default=start_us) - start_us)
        length_us = None if end_us is None else end_us - begin_us
        events = _in_time(source, chunk.events, zero_us, length_us, "events", latest)
        triggers = _in_time(source, chunk.triggers, zero_us, length_us, "triggers", latest)
        if section.trigger_channel is not None:
            triggers = triggers[triggers["id"] == section.trigger_channel]
        yield EventChunk(_in_window(source, events, roi), triggers)
    source.last_us = max(latest.values())


def _first_us(chunk: EventChunk) -> int:
    return min(int(part["t"].min()) for part in (chunk.events, chunk.triggers) if len(part))


def _in_time(
    source: Source,
    part: npt.NDArray[np.void],
    zero_us: int,
    length_us: int | None,
    name: str,
    latest: dict[str, int],
) -> npt.NDArray[np.void]:
    """Return what of `part` lies in the time window and does not go back, with times from its beginning."""
    if not len(part):
        return part
    part = part.copy()
    part["t"] -= zero_us
    early = part["t"] < 0
    late = np.zeros_like(early) if length_us is None else part["t"] >= length_us
    source.counts["before_start"] += int(early.sum())
    source.counts["after_end"] += int(late.sum())
    part = part[~(early | late)]
    highest = np.maximum.accumulate(np.concatenate([[latest[name]], part["t"]]))
    backward = part["t"] < highest[:-1]
    source.counts["backward"] += int(backward.sum())
    latest[name] = int(highest[-1])
    kept: npt.NDArray[np.void] = part[~backward]
    return kept


def _in_window(source: Source, events: npt.NDArray[np.void], roi: Roi) -> npt.NDArray[np.void]:
    x, y = events["x"].astype(np.int64) - roi.x, events["y"].astype(np.int64) - roi.y
    inside = (x >= 0) & (x < roi.width) & (y >= 0) & (y < roi.height)
    source.counts["outside_roi"] += int(len(events) - inside.sum())
    return events if inside.all() else events[inside]
