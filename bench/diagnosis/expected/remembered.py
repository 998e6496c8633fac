"""What was simulated a short while ago: a search comes back to some of it, and it is the same bit by bit."""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING, Final, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Hashable

__all__ = ["Remembered"]

_Thing = TypeVar("_Thing")

#: Recordings that are remembered, some 15 kB each.
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
