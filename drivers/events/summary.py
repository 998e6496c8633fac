"""What is in a recording, in numbers: counts, times, sums, rates, and what broke the rules of its format."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from drivers.events.raw import CHUNK_BYTES, open_recording
from drivers.events.types import EventChunk

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    import numpy.typing as npt

__all__ = ["Summary", "Tally", "summarise", "tally"]

#: Small chunks are put together to so many events and triggers before they are counted.
_BATCH: Final = 1 << 16


@dataclass(slots=True)
class Tally:
    """Counts and sums over the events and triggers of a stream. Times are in us; None without events."""

    n_cd: int = 0  #: events
    n_on: int = 0
    n_off: int = 0
    t_first: int | None = None  #: of the event that came first
    t_last: int | None = None
    t_min: int | None = None
    t_max: int | None = None
    n_backward_steps: int = 0  #: events earlier than the one before
    x_max: int | None = None
    y_max: int | None = None
    sum_t: int = 0
    sum_x: int = 0
    sum_y: int = 0
    n_trigger: int = 0
    trigger_ids: list[int] = field(default_factory=list)  #: channels that were seen, ascending
    trigger_rising: int = 0

    def add(self, chunk: EventChunk) -> None:
        """Add the next chunk of the stream."""
        if len(chunk.events):
            self._add_events(chunk.events)
        triggers = chunk.triggers
        self.n_trigger += len(triggers)
        self.trigger_rising += int(np.count_nonzero(triggers["p"]))
        self.trigger_ids = sorted({*self.trigger_ids, *np.unique(triggers["id"]).tolist()})

    def _add_events(self, events: npt.NDArray[np.void]) -> None:
        t = np.ascontiguousarray(events["t"])
        first, lowest, highest = int(t[0]), int(t.min()), int(t.max())
        self.n_backward_steps += int(np.count_nonzero(np.diff(t) < 0))
        if self.t_last is not None:
            self.n_backward_steps += first < self.t_last
        self.t_first = first if self.t_first is None else self.t_first
        self.t_last = int(t[-1])
        self.t_min = lowest if self.t_min is None else min(self.t_min, lowest)
        self.t_max = highest if self.t_max is None else max(self.t_max, highest)
        # Counted from the lowest, so that the sum of a chunk fits int64; the whole is a Python integer without limit.
        self.sum_t += int(np.sum(t - lowest)) + lowest * len(t)
        self.n_cd += len(events)
        on = int(np.count_nonzero(events["p"]))
        self.n_on += on
        self.n_off += len(events) - on
        self.x_max = max(self.x_max or 0, int(events["x"].max()))
        self.y_max = max(self.y_max or 0, int(events["y"].max()))
        self.sum_x += int(events["x"].sum(dtype=np.int64))
        self.sum_y += int(events["y"].sum(dtype=np.int64))

    def rates_hz(self) -> dict[str, float | None]:
        """Return mean rates between the first and the last event, 1/s; None where there is no such time."""
        counts = {"cd": self.n_cd, "on": self.n_on, "off": self.n_off, "trigger": self.n_trigger}
        duration_us = 0 if self.t_min is None or self.t_max is None else self.t_max - self.t_min
        return {name: n * 1e6 / duration_us if duration_us else None for name, n in counts.items()}


@dataclass(frozen=True, slots=True)
class Summary:
    """What is in a recording. What does not apply to its format is None."""

    format: str
    sensor: tuple[int, int] | None  #: width and height, pixels
    sensor_from: str  #: who said so: ``option``, ``file``, or ``events`` (the smallest sensor that holds them all)
    tally: Tally
    header: tuple[str, ...]  #: lines of text at the start of the file
    sha256: str  #: of the whole file
    word_types: dict[int, int] | None = None  #: number of words by type
    violations: dict[str, int] | None = None
    erc: dict[str, int] | None = None  #: reports of the event-rate controller

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain values, ready for JSON; what does not apply is left out."""
        tally = {name: getattr(self.tally, name) for name in Tally.__dataclass_fields__}
        types = None if self.word_types is None else {str(kind): n for kind, n in self.word_types.items()}
        everything = {
            "format": self.format,
            "sensor": None if self.sensor is None else list(self.sensor),
            "sensor_from": self.sensor_from,
            **tally,
            "word_types": types,
            "header": list(self.header),
            "sha256": self.sha256,
            "violations": self.violations,
            "erc": self.erc,
            "rates_hz": self.tally.rates_hz(),
        }
        optional = ("word_types", "violations", "erc")
        return {key: value for key, value in everything.items() if value is not None or key not in optional}


def summarise(
    path: str | Path,
    *,
    format: str | None = None,  # noqa: A002 - the word that the file itself uses
    width: int | None = None,
    height: int | None = None,
    chunk_bytes: int = CHUNK_BYTES,
) -> Summary:
    """Read a recording to its end and say what is in it, in bounded memory.

    Parameters
    ----------
    path, format, width, height, chunk_bytes
        As in :func:`drivers.events.raw.open_recording`.

    Raises
    ------
    InputError
        If the file cannot be read, or its format is not known.
    """
    recording = open_recording(path, format=format, width=width, height=height, chunk_bytes=chunk_bytes)
    counts = tally(recording.chunks())
    sensor, sensor_from = sensor_size(
        counts, recording.width, recording.height, "file" if width is None else "option"
    )
    erc = recording.erc_counts
    return Summary(
        format=recording.format,
        sensor=sensor,
        sensor_from=sensor_from,
        tally=counts,
        header=recording.header.lines,
        sha256=sha256_of(recording.path),
        word_types=recording.word_types,
        violations=recording.violations,
        erc={"n_before": erc.n_before, "before": erc.before, "n_after": erc.n_after, "after": erc.after},
    )


def tally(chunks: Iterable[EventChunk]) -> Tally:
    """Count the events and triggers of a stream."""
    counts = Tally()
    for batch in _batches(chunks):
        counts.add(batch)
    return counts


def sensor_size(
    counts: Tally, width: int | None, height: int | None, said_by: str
) -> tuple[tuple[int, int] | None, str]:
    """Return the size of the sensor and who said it; if nobody did, the smallest one that holds all events."""
    if width is not None and height is not None:
        return (width, height), said_by
    if counts.x_max is None or counts.y_max is None:
        return None, "events"
    return (counts.x_max + 1, counts.y_max + 1), "events"


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _batches(chunks: Iterable[EventChunk]) -> Iterator[EventChunk]:
    """Put small chunks together: what is counted costs the same for one event as for a thousand."""
    waiting: list[EventChunk] = []
    n = 0
    for chunk in chunks:
        waiting.append(chunk)
        n += len(chunk.events) + len(chunk.triggers)
        if n >= _BATCH:
            yield _join(waiting)
            waiting, n = [], 0
    if waiting:
        yield _join(waiting)


def _join(chunks: list[EventChunk]) -> EventChunk:
    if len(chunks) == 1:
        return chunks[0]
    return EventChunk(np.concatenate([c.events for c in chunks]), np.concatenate([c.triggers for c in chunks]))
