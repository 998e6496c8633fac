"""Reading the description of one point file; its events stay on disk.

A file that is not what the format says raises :class:`~bench.store.errors.RunError`, in one line that names the file
and the dataset. What the format does not know is kept (root attributes) or ignored.
"""

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING, Any, Final, cast, get_args

import numpy as np

from bench.store import layout
from bench.store.data import PointData
from bench.store.datasets import Datasets, opened, plain
from protocols.points import Polarity, Roi, Waveform

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    from bench.store.layout import Dataset

__all__ = ["read_point"]

_log = logging.getLogger("evs_bench.store")
_REQUIRED: Final = object()


def read_point(path: Path, roi: Roi) -> PointData:
    """Return what the point file `path` says; the events stay on disk.

    Parameters
    ----------
    path
        An HDF5 file of format ``evs-bench-point/1``.
    roi
        The run's window, for a point that does not have its own.

    Raises
    ------
    RunError
        If the file is not readable, not of the format, or does not agree with itself.
    """
    with opened(path) as file:
        return _Reader(path, file).point(roi)


class _Reader(Datasets):
    """Reads and checks the parts of one open point file."""

    def __init__(self, path: Path, file: Any) -> None:
        super().__init__(path, file)
        self.attributes = {str(key): plain(value) for key, value in file.attrs.items()}

    def point(self, roi: Roi) -> PointData:
        """Return the whole description."""
        layout.check_format(self.attributes.get("format"), layout.POINT_FORMAT, str(self.path))
        self.note_missing_units()
        log_contrast = self.number("log_contrast", lowest=0.0)
        n_events = self.event_count()
        pulses = self.pulses(log_contrast)
        t, lux = self.stimulus()
        trigger_t, trigger_p = self.triggers()
        return PointData(
            path=self.path,
            index=self.whole("index"),
            waveform=cast("Waveform", self.choice("waveform", get_args(Waveform))),
            polarity=cast("Polarity", self.choice("polarity", get_args(Polarity))),
            baseline_lux=self.number("baseline_lux", lowest=0.0),
            log_contrast=log_contrast,
            duration_s=self.number("duration_s", lowest=0.0),
            nd_od=self.number("nd_od"),
            refractory_s=self.number("refractory_s", missing=math.nan),
            temperature_c=self.number("temperature_c", missing=math.nan),
            roi=self.roi(roi),
            n_events=n_events,
            stimulus_t_s=t,
            stimulus_lux=lux,
            triggers_t_us=trigger_t,
            triggers_p=trigger_p,
            masked=self.table(layout.MASKED),
            gaps_s=self.table(layout.GAPS),
            bias=self.numbers_of("bias"),
            quality=self.attributes_of("quality"),
            attributes=self.attributes,
            until_s=math.inf,
            stored_roi=None,
            **pulses,
        )

    def note_missing_units(self) -> None:
        """Log which datasets do not tell their units; they are taken for those of the format."""
        bare = [d for d in layout.REQUIRED if d.path in self.file and "units" not in self.file[d.path].attrs]
        if bare:
            taken = ", ".join(f"/{d.path} ({d.units[0]})" for d in bare)
            _log.warning("%s: datasets without units, taken for those of the format: %s", self.path, taken)

    # Attributes of the file.

    def attribute(self, name: str) -> Any:
        """Return a root attribute that must be there."""
        if name not in self.attributes:
            raise self.fail(f"the attribute {name!r} is missing")
        return self.attributes[name]

    def number(self, name: str, lowest: float = -math.inf, missing: Any = _REQUIRED) -> float:
        """Return a root attribute as a number; where `lowest` is given it must be finite and not below it."""
        if missing is not _REQUIRED and name not in self.attributes:
            return float(missing)
        value = self.attribute(name)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.fail(f"the attribute {name!r} is {value!r}, expected a number")
        if lowest > -math.inf and not lowest <= value < math.inf:
            raise self.fail(f"the attribute {name!r} is {value!r}, expected a number of at least {lowest:g}")
        return float(value)

    def whole(self, name: str) -> int:
        """Return a root attribute as a whole number from 0, whatever type it was stored as."""
        value = self.number(name, lowest=0.0)
        if value != math.trunc(value):
            raise self.fail(f"the attribute {name!r} is {value!r}, expected a whole number")
        return int(value)

    def choice(self, name: str, allowed: tuple[str, ...]) -> str:
        """Return a root attribute that must be one of `allowed`."""
        value = self.attribute(name)
        if value not in allowed:
            raise self.fail(f"the attribute {name!r} is {value!r}, expected one of {', '.join(allowed)}")
        return cast("str", value)

    def roi(self, run_roi: Roi) -> Roi:
        """Return the point's own window where it has one, else the run's."""
        if "roi_x" not in self.attributes:
            return run_roi
        roi = Roi(self.whole("roi_x"), self.whole("roi_y"), self.whole("roi_width"), self.whole("roi_height"))
        if not (roi.width and roi.height):
            raise self.fail(f"the window of {roi.width} x {roi.height} pixels is empty")
        return roi

    def attributes_of(self, group: str) -> dict[str, Any]:
        """Return the attributes of an optional group."""
        if group not in self.file:
            return {}
        return {str(key): plain(value) for key, value in self.file[group].attrs.items()}

    def numbers_of(self, group: str) -> dict[str, float]:
        """Return the attributes of an optional group that are numbers."""
        found = self.attributes_of(group)
        return {key: float(value) for key, value in found.items() if isinstance(value, int | float)}

    # Datasets.

    def vector(self, spec: Dataset) -> npt.NDArray[Any]:
        """Return the values of a dataset that must be there."""
        return np.asarray(self.dataset(spec)[()], spec.dtype)

    def table(self, spec: Dataset) -> npt.NDArray[Any]:
        """Return the rows of an optional dataset; no rows where it is not there."""
        if spec.path not in self.file:
            return np.empty((0, spec.columns), spec.dtype)
        return self.vector(spec)

    def stimulus(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return the times (s) and levels (lux) of the stimulus."""
        n = self.same_length(layout.STIMULUS_T, layout.STIMULUS_LUX)
        t, lux = self.vector(layout.STIMULUS_T), self.vector(layout.STIMULUS_LUX)
        if n == 0:
            raise self.fail("the dataset /stimulus/t is empty, expected at least the level at t = 0")
        self.require_ascending(layout.STIMULUS_T, t)
        if not (np.isfinite(lux).all() and (lux >= 0.0).all()):
            raise self.fail("the dataset /stimulus/illuminance holds values that are no illuminance (negative, NaN)")
        return t, lux

    def triggers(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.uint8]]:
        """Return the times (us) and polarities of the external triggers."""
        self.same_length(layout.TRIGGER_T, layout.TRIGGER_P)
        t = self.vector(layout.TRIGGER_T)
        self.require_ascending(layout.TRIGGER_T, t)
        return t, self.vector(layout.TRIGGER_P)

    def pulses(self, log_contrast: float) -> dict[str, npt.NDArray[Any]]:
        """Return the response windows, as the fields of :class:`PointData`."""
        k = self.same_length(layout.PULSE_START, layout.PULSE_STOP, layout.PULSE_KIND)
        start, stop = self.vector(layout.PULSE_START), self.vector(layout.PULSE_STOP)
        self.require_ascending(layout.PULSE_START, start)
        if not (np.isfinite(stop).all() and (stop > start).all()):
            raise self.fail("the dataset /pulses/stop has a window that ends before it begins")
        kind = self.vector(layout.PULSE_KIND)
        if (kind > 1).any():
            raise self.fail(f"the dataset /pulses/kind holds {int(kind.max())}, expected 0 or 1")
        valid = self.per_pulse(layout.PULSE_VALID, np.ones(k, np.uint8))
        return {
            "pulse_start_s": start,
            "pulse_stop_s": stop,
            "pulse_kind": kind,
            "pulse_valid": valid.astype(np.bool_),
            "pulse_log_contrast": self.per_pulse(layout.PULSE_CONTRAST, np.full(k, log_contrast)),
        }

    def per_pulse(self, spec: Dataset, missing: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return an optional dataset with one value for each pulse."""
        if spec.path not in self.file:
            return missing
        self.same_length(layout.PULSE_START, spec)
        return self.vector(spec)

    def require_ascending(self, spec: Dataset, values: npt.NDArray[Any]) -> None:
        """Raise unless `values` are finite and never fall."""
        if not np.isfinite(values).all():
            raise self.fail(f"the dataset /{spec.path} holds a value that is no number")
        falls = np.flatnonzero(values[1:] < values[:-1])
        if falls.size:
            raise self.fail(f"the dataset /{spec.path} goes back in time at entry {int(falls[0]) + 1}")
