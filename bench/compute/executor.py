"""The one way in which the bench does many independent things at once: one function, many items, some workers.

What an item gives must follow from the item alone (its seeds come from point and pixel), so that the result is the
same for any number of workers, on one machine or several, and an item whose worker died can be done again.
"""

from __future__ import annotations

import uuid
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, Final, Self, TypeVar

from bench.compute.work import Setup, Work
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable
    from types import TracebackType

    from bench.compute.work import Outcome

__all__ = ["ATTEMPTS", "ComputeError", "Executor", "ItemFailed", "WorkerLost"]

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

#: So many workers may be lost over one item.
ATTEMPTS: Final = 3
_LONGEST_NAME: Final = 80


class ComputeError(InputError):
    """There is nobody to compute: a worker that does not start, a cluster that does not answer."""


class WorkerLost(ComputeError):
    """An item whose worker died each time that it was tried."""


class ItemFailed(Exception):
    """The function raised for an item; `__cause__` is what it raised.

    Parameters
    ----------
    index
        Position of the item, from 0.
    name
        The item, for people.
    error
        What the function raised.
    """

    def __init__(self, index: int, name: str, error: BaseException) -> None:
        super().__init__(f"{name}: {' '.join(str(error).split()) or type(error).__name__}")
        self.index = index
        self.name = name
        self.error = error
        self.__cause__ = error


class Executor(ABC):
    """Workers that do items. As a context manager it leaves no process behind, whatever happens.

    Parameters
    ----------
    setup
        What each worker does once before its first item, e.g. loading a user's own effects; it is pickled.
    tell
        Called with a line for the operator when a worker was lost.
    """

    def __init__(self, setup: Callable[[], object] | None = None, tell: Callable[[str], None] | None = None) -> None:
        self._setup = Setup(uuid.uuid4().hex, () if setup is None else (setup,))
        self._tell = tell or (lambda _: None)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def map(
        self,
        function: Callable[[_Item], _Result],
        items: Iterable[_Item],
        *,
        ordered: bool = False,
        name: Callable[[_Item], str] | None = None,
    ) -> Generator[tuple[int, _Result]]:
        """Yield the index of each item and what `function` gives for it, in the order in which they are finished.

        An item is taken from `items` when a worker is free for it, so neither items nor results pile up. One `map`
        at a time.

        Parameters
        ----------
        function, items
            Both are pickled: a function of a module, not a lambda.
        ordered
            In the order of the items instead. A slow item then keeps the others waiting: no more than one result for
            each worker is held back.
        name
            What to call an item in an error; default is its text.

        Raises
        ------
        ItemFailed
            `function` raised. Items under way are given up.
        WorkerLost
            Workers died over one item, time after time.
        ComputeError
            There are no workers.
        """
        names: dict[int, str] = {}
        held: dict[int, Any] = {}
        left, due = enumerate(items), 0

        def refill() -> None:
            while len(names) + len(held) < self._room():
                index, item = next(left, (-1, None))
                if index < 0:
                    return
                names[index] = _name(index, item, name)
                self._start(index, names[index], Work(function, item, self._setup))

        try:
            refill()
            while names:
                index, outcome = self._finished()
                called = names.pop(index)
                if outcome.failure is not None:
                    raise ItemFailed(index, called, outcome.failure.error())
                held[index] = outcome.result
                deliver = [index]
                if ordered:
                    deliver = []
                    while due in held:
                        deliver.append(due)
                        due += 1
                results = [(i, held.pop(i)) for i in deliver]
                refill()  # before the results are looked at: the workers need not wait for that
                yield from results
        finally:
            if names:
                self._give_up()

    def close(self) -> None:
        """Let the workers go; harmless if it was done."""
        self._give_up()

    @abstractmethod
    def _room(self) -> int:
        """Return how many items may be under way."""

    @abstractmethod
    def _start(self, index: int, name: str, work: Work) -> None:
        """Begin an item; there is room for it."""

    @abstractmethod
    def _finished(self) -> tuple[int, Outcome]:
        """Return the next item to be finished, and what became of it."""

    @abstractmethod
    def _give_up(self) -> None:
        """Forget the items that are under way."""


def _name(index: int, item: Any, name: Callable[[Any], str] | None) -> str:
    if name is not None:
        return name(item)
    text = str(item)
    return f"item {index} ({text[:_LONGEST_NAME]}{'...' if len(text) > _LONGEST_NAME else ''})"
