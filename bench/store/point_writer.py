"""Writing one point file: under a temporary name until it is complete and on disk."""

from __future__ import annotations

import contextlib
import errno
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench.store import layout
from bench.store.durable import sync_file, sync_folder
from bench.store.errors import RunError
from bench.store.signals import signals_later
from bench.store.sink import Sink

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import numpy.typing as npt

    from bench.store.layout import Dataset
    from bench.store.record import PointRecord, PulseRecord, StimulusRecord
    from drivers.events.types import EventChunk

__all__ = ["PointWriter", "cannot_write"]

_CHUNK: Final = 1 << 16  #: rows of a compressed block in the file
_BUFFERED: Final = 1 << 18  #: events that are collected before they are written
_TIMES: Final = (("t_written", "t_written_s"), ("t_acknowledged", "t_acknowledged_s"), ("t_settled", "t_settled_s"))


class PointWriter:
    """Takes the events of one recording as they come, and at its end the rest.

    The file appears under its name in :meth:`finish` or not at all. Use it as a context manager: what was not
    finished is removed at its end. Ctrl-C and the like that come while HDF5 is at work are delivered right after.

    Parameters
    ----------
    path
        The final name.

    Raises
    ------
    RunError
        From every method: the file cannot be written, in one line.
    """

    def __init__(self, path: Path) -> None:
        import h5py

        self.path = path
        self.part = path.with_name(path.name + layout.PART_SUFFIX)
        self.n_events = 0
        self.n_triggers = 0
        self._held: list[npt.NDArray[np.void]] = []
        self._held_events = 0
        self._file: Any = None
        try:
            self._sink = Sink(self.part)
        except OSError as error:
            raise cannot_write(path, error) from error
        try:
            with self._writing():
                self._file = h5py.File(self._sink, "w")
                self._columns = {d.path: self._growing(d) for d in (*layout.EVENT_DATASETS, *_TRIGGERS)}
        except BaseException:  # an interrupt too
            self.abandon()
            raise

    def __enter__(self) -> PointWriter:
        """Return the writer itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Remove what was not finished."""
        self.abandon()

    def append(self, chunk: EventChunk) -> None:
        """Add a stretch of the event stream; times in us since the start of the recording."""
        with self._writing():
            self._append_triggers(chunk.triggers)
            self._held.append(chunk.events)
            self._held_events += len(chunk.events)
            if self._held_events >= _BUFFERED:
                self._flush_events()

    def times_and_polarities(self) -> Iterator[tuple[npt.NDArray[np.int64], npt.NDArray[np.uint8]]]:
        """Yield times (us) and polarities of all events that are in, stretch by stretch."""
        t, p = self._columns["events/t"], self._columns["events/p"]
        for first in range(0, t.shape[0], _BUFFERED):
            with self._writing():
                part = t[first : first + _BUFFERED], p[first : first + _BUFFERED]
            yield part
        for events in self._held:
            yield events["t"], events["p"]

    def finish(self, record: PointRecord) -> None:
        """Write `record`, bring the file to disk, and give it its name."""
        with self._writing():
            self._flush_events()
            self._write_attributes(record)
            self._write_stimulus(record.stimulus)
            self._write_pulses(record.pulses)
            self._write_groups(record)
            self._file.close()
            self._sink.close()
            self._sink.check()
            sync_file(self.part)
            self.part.replace(self.path)
            sync_folder(self.path.parent)

    def abandon(self) -> None:
        """Close and remove the temporary file, if it is there; raises nothing of its own."""
        with signals_later():
            if self._file is not None:
                self._file.close()
            self._sink.close()
            with contextlib.suppress(OSError):
                self.part.unlink(missing_ok=True)

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Turn what the file system raises, or has raised behind HDF5's back, into one line; hold signals back."""
        with signals_later():
            try:
                yield
                self._sink.check()
            except OSError as error:
                raise cannot_write(self.path, error) from error

    def _growing(self, spec: Dataset) -> Any:
        data = self._file.create_dataset(
            spec.path, (0,), spec.dtype, maxshape=(None,), chunks=(_CHUNK,), compression="gzip", compression_opts=1,
            shuffle=True,
        )  # fmt: skip
        data.attrs["units"] = spec.units[0]
        return data

    def _extend(self, spec: Dataset, values: npt.NDArray[Any]) -> None:
        data = self._columns[spec.path]
        start = data.shape[0]
        data.resize((start + len(values),))
        data[start:] = values

    def _flush_events(self) -> None:
        if not self._held_events:
            return
        events = np.concatenate(self._held)
        for spec in layout.EVENT_DATASETS:
            self._extend(spec, events[spec.path[-1]])
        self.n_events += len(events)
        self._held, self._held_events = [], 0

    def _append_triggers(self, triggers: npt.NDArray[np.void]) -> None:
        if len(triggers):
            self._extend(layout.TRIGGER_T, triggers["t"])
            self._extend(layout.TRIGGER_P, triggers["p"])
            self.n_triggers += len(triggers)

    def _put(self, spec: Dataset, values: Any) -> None:
        data = self._file.create_dataset(spec.path, data=np.asarray(values, spec.dtype))
        data.attrs["units"] = spec.units[0]

    def _write_attributes(self, record: PointRecord) -> None:
        attributes: dict[str, Any] = {
            "format": layout.POINT_FORMAT,
            "index": record.index,
            "waveform": record.waveform,
            "polarity": record.polarity,
            "baseline_lux": float(record.baseline_lux),
            "log_contrast": float(record.log_contrast),
            "duration_s": float(record.duration_s),
            "nd_od": float(record.nd_od),
            "refractory_s": float(record.refractory_s),
            "temperature_c": float(record.temperature_c),
        }
        if record.roi is not None:
            attributes |= {f"roi_{name}": getattr(record.roi, name) for name in ("x", "y", "width", "height")}
        attributes |= {name: value for name, value in record.attributes.items() if value is not None}
        self._file.attrs.update(attributes)

    def _write_stimulus(self, stimulus: StimulusRecord) -> None:
        self._put(layout.STIMULUS_T, stimulus.t_s)
        self._put(layout.STIMULUS_LUX, stimulus.lux)
        if stimulus.trigger is not None:
            self._put(layout.STIMULUS_TRIGGER, stimulus.trigger)
        for name, field in _TIMES:
            values = getattr(stimulus, field)
            if values is not None:
                self._put(layout.Dataset(f"stimulus/{name}", "float64", ("s",)), values)

    def _write_pulses(self, pulses: PulseRecord) -> None:
        self._put(layout.PULSE_START, pulses.start_s)
        self._put(layout.PULSE_STOP, pulses.stop_s)
        self._put(layout.PULSE_KIND, pulses.kind)
        if pulses.valid is not None:
            self._put(layout.PULSE_VALID, pulses.valid)

    def _write_groups(self, record: PointRecord) -> None:
        if record.bias:
            self._file.create_group("bias").attrs.update(record.bias)
        if record.quality:
            self._file.create_group("quality").attrs.update(record.quality)
        if record.gaps_s:
            self._put(layout.GAPS, record.gaps_s)
        if record.masked is not None:
            self._put(layout.MASKED, record.masked)


_TRIGGERS: Final = (layout.TRIGGER_T, layout.TRIGGER_P)


def cannot_write(path: Path, error: OSError) -> RunError:
    """Return the one line that says that `path` could not be written, why, and what to do where that is known."""
    advice = _ADVICE.get(error.errno or 0)
    if error.errno == errno.ENOENT and not path.parent.exists():
        advice = f"{_missing(path)} was removed or renamed, put it back"
    return RunError(f"{path}: could not be written: {error.strerror or error}{f'; {advice}' if advice else ''}")


def _missing(path: Path) -> Path:
    """Return the outermost folder above `path` that is not there."""
    return [folder for folder in path.parents if not folder.exists()][-1]


_ROOM: Final = "make room on this disk"
_RIGHT: Final = "let it be written, or choose another folder"
_ADVICE: Final = {
    errno.ENOSPC: _ROOM,
    getattr(errno, "EDQUOT", errno.ENOSPC): "your share of this disk is used up: make room",
    errno.EFBIG: "this disk, or your account, takes no file of this size",
    errno.EROFS: _RIGHT,
    errno.EACCES: _RIGHT,
    errno.EPERM: _RIGHT,
    errno.EIO: "the disk fails: look at it before you go on",
}
