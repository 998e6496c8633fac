"""One open point file: its datasets are what the format says, or the error names the file and the dataset."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench.store import layout
from bench.store.errors import RunError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from bench.store.layout import Dataset

__all__ = ["Datasets", "opened", "plain"]

#: What h5py raises on damaged files, depending on where the damage is.
_DAMAGE: Final = (OSError, KeyError, RuntimeError, ValueError, TypeError, OverflowError, MemoryError, AttributeError)


@contextlib.contextmanager
def opened(path: Path) -> Iterator[Any]:
    """Open an HDF5 file; whatever h5py raises while it is read becomes one line."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            yield file
    except RunError:
        raise
    except FileNotFoundError as error:
        raise RunError(f"{path}: there is no such file") from error
    except PermissionError as error:
        raise RunError(f"{path}: no permission to read it") from error
    except _DAMAGE as error:
        raise RunError(f"{path}: damaged: {' '.join(str(error).split())}") from error


class Datasets:
    """The datasets of one open point file, checked as they are asked for.

    Parameters
    ----------
    path
        For messages.
    file
        What h5py opened.
    """

    def __init__(self, path: Path, file: Any) -> None:
        self.path = path
        self.file = file

    def fail(self, what: str) -> RunError:
        """Return the error that says `what` is wrong with this file."""
        return RunError(f"{self.path}: {what}")

    def dataset(self, spec: Dataset) -> Any:
        """Return a dataset that must be there, after a check of its type, shape and units."""
        if spec.path not in self.file:
            raise self.fail(f"the dataset /{spec.path} is missing")
        return _checked(self.path, self.file[spec.path], spec)

    def same_length(self, *specs: Dataset) -> int:
        """Return the common length of several datasets."""
        lengths = {spec.path: self.dataset(spec).shape[0] for spec in specs}
        if len(set(lengths.values())) > 1:
            found = ", ".join(f"/{path} has {n}" for path, n in lengths.items())
            raise self.fail(f"datasets of different length: {found}")
        return int(next(iter(lengths.values())))

    def event_count(self) -> int:
        """Return the number of events."""
        return self.same_length(*layout.EVENT_DATASETS)


def _checked(path: Path, dataset: Any, spec: Dataset) -> Any:
    """Return `dataset` if type, shape and units are those of `spec`, else raise :class:`RunError`."""
    name = f"{path}: the dataset /{spec.path}"
    dtype, shape = getattr(dataset, "dtype", None), getattr(dataset, "shape", None)
    if dtype is None or shape is None:
        raise RunError(f"{name} is no array")
    if dtype.kind not in "iuf" or not np.can_cast(dtype, spec.dtype, "safe"):
        raise RunError(f"{name} is of type {dtype}, expected {spec.dtype}")
    expected = f"(n, {spec.columns})" if spec.columns else "(n,)"
    if len(shape) != (2 if spec.columns else 1) or (spec.columns and shape[1] != spec.columns):
        raise RunError(f"{name} has the shape {shape}, expected {expected}")
    units = plain(dataset.attrs.get("units"))
    if units is not None and units not in spec.units:
        raise RunError(f"{name} has the units {units!r}, expected {spec.units[0]!r}")
    return dataset


def plain(value: Any) -> Any:
    """Return an attribute as a plain Python value: text for bytes, a number for arrays of one."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    if isinstance(value, np.generic):
        value = value.item()
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value
