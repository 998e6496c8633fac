"""Views of a user's own: loading the file that was named, and looking with what is in it or in a plug-in."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final, get_args

import numpy as np

from bench.diagnosis.views.base import Kind, Part, Statistic, View
from protocols.errors import InputError, Problem
from protocols.user_module import classes_of, failure, place_of, run_file, sha256_of

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator

    from bench.diagnosis.recorded.recording import Recording

__all__ = ["ViewSource", "own_view", "read_view_file"]

_ID: Final = re.compile(r"[a-z][a-z0-9_]*")


class _Own(View):
    """A user's view; what goes wrong in it, or is no statistic, is told in one line."""

    def __init__(self, view: View, source: str) -> None:
        self._view = view
        self._source = source
        self.id, self.title, self.unit = view.id, view.title, view.unit  # type: ignore[misc]
        self.of_array, self.fitted = view.of_array, view.fitted  # type: ignore[misc]

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield what the user's view yields.

        Raises
        ------
        InputError
            It raises an error, or yields what is no statistic of this recording.
        """
        try:
            for statistic in self._view.look(recording):
                self._check(statistic, recording)
                yield statistic
        except InputError:
            raise
        except Exception as error:
            raise InputError(failure(error, self._source, f"{self._source}: view {self.id}")) from error

    def _check(self, found: Statistic, recording: Recording) -> None:
        if not isinstance(found, Statistic):
            raise self._refused(f"yielded {type(found).__name__}; expected Statistic(part, kind, top, bottom)")
        if found.part not in get_args(Part) or found.kind not in get_args(Kind):
            raise self._refused(
                f"part {found.part!r}, kind {found.kind!r}; expected one of {get_args(Part)}, of {get_args(Kind)}"
            )
        for name, values in (("top", np.asarray(found.top)), ("bottom", np.asarray(found.bottom))):
            if values.ndim != 1 or not np.all(np.isfinite(values)):
                raise self._refused(f"{name} of shape {values.shape}; expected one finite number for each cluster")
            if not found.by_pulse and values.size != recording.pixels:
                raise self._refused(f"{name} has {values.size} numbers; expected {recording.pixels}, one a pixel")

    def _refused(self, text: str) -> InputError:
        return InputError(f"{self._source}: view {self.id}: {text}")


@dataclass(frozen=True, slots=True)
class ViewSource:
    """Where views came from that are not built in: a file, or a plug-in."""

    path: str  #: of the file, in full; of a plug-in, of the file that holds the class, or empty
    sha256: str  #: of that file; empty without one
    views: tuple[View, ...]
    package: str = ""  #: name and version of the package that brings a plug-in


def read_view_file(path: str | os.PathLike[str]) -> ViewSource:
    """Run the Python file `path`, and return the views that it defines.

    Raises
    ------
    InputError
        The file cannot be read or run, has no view in it, or one that cannot be used; one line with file and line.
    """
    source = str(path)
    module, _ = run_file(path, "views")
    classes = classes_of(module, View)
    if not classes:
        raise InputError(Problem("has no view in it; expected a class derived from View", source))
    views = tuple(own_view(cls, place_of(cls, source), source) for cls in classes)
    where = Path(path).resolve()
    return ViewSource(str(where), sha256_of(where), views)


def own_view(cls: type[View], place: str, source: str) -> View:
    """Return a view of a class; what goes wrong when it looks is told in one line.

    Parameters
    ----------
    place
        Where the class stands, for what is wrong with it.
    source
        The file of the class, or another name where there is none, for what goes wrong later.

    Raises
    ------
    InputError
        The class cannot be used as a view.
    """
    return _Own(_made(cls, place), source)


def _made(cls: type[View], place: str) -> View:
    name = cls.__name__
    if not isinstance(getattr(cls, "id", None), str) or not _ID.fullmatch(cls.id):
        raise InputError(
            f"{place}: {name}: id is {getattr(cls, 'id', None)!r}; expected a name of small letters, digits and "
            "underscores"
        )
    if not isinstance(getattr(cls, "title", None), str):
        raise InputError(f"{place}: {name}: has no title; expected what it shows, for an axis")
    if not isinstance(cls.unit, str):
        raise InputError(f"{place}: {name}: unit is {cls.unit!r}; expected text, as 'Hz'")
    if cls.look is View.look:
        raise InputError(f"{place}: {name}: does not look; expected look(self, recording)")
    try:
        return cls()
    except TypeError as error:
        raise InputError(f"{place}: {name}: cannot be made without arguments ({error})") from error
