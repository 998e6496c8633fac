"""Simulated sensors of a short while ago: a search comes back to some of them, and they are the same bit by bit."""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING, Final, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Hashable, Sequence

    from sim_backend.pixel.model import PixelModel

__all__ = ["Remembered", "names_of"]

_Thing = TypeVar("_Thing")

#: Recordings that are remembered, some 20 kB each.
_MOST: Final = 4096


class Remembered(Generic[_Thing]):
    """The things that were asked for last, by what they come from.

    Parameters
    ----------
    size
        Of each thing, in recordings: the more, the fewer are kept.
    """

    def __init__(self, size: int) -> None:
        self._most = _MOST // max(size, 1)
        self._known: OrderedDict[Hashable, _Thing] = OrderedDict()

    def get(self, key: Hashable) -> _Thing | None:
        """Return what is known, if it is."""
        if key in self._known:
            self._known.move_to_end(key)
        return self._known.get(key)

    def put(self, key: Hashable, thing: _Thing) -> None:
        """Keep a thing, in the place of the one that nobody has asked for the longest."""
        self._known[key] = thing
        self._known.move_to_end(key)
        while len(self._known) > self._most:
            self._known.popitem(last=False)


def names_of(models: Sequence[PixelModel]) -> Hashable:
    """Return what tells the models of all points from others: there are few different ones, of many points."""
    names = {key: repr(model) for key, model in {id(m): m for m in models}.items()}
    return tuple(names[id(model)] for model in models)
