"""What is sent to a worker, what comes back, and how an exception travels.

A worker answers with bytes that it has pickled itself, so that a result which cannot be pickled is an error of its
item, and not the end of the worker.
"""

from __future__ import annotations

import pickle
import traceback
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["Failure", "Outcome", "Setup", "Work", "perform", "perform_pickled"]

#: Setups that this process has done.
_prepared: set[str] = set()


@dataclass(frozen=True, slots=True)
class Setup:
    """What a worker does once, before its first item."""

    name: str  #: of the executor: a worker of a cluster may see several of them
    functions: tuple[Callable[[], object], ...] = ()

    def prepare(self) -> None:
        """Do it, unless this process has done it."""
        if self.name not in _prepared:
            for function in self.functions:
                function()
            _prepared.add(self.name)


@dataclass(frozen=True, slots=True)
class Work:
    """One item, with all that is to be done to it."""

    function: Callable[[Any], Any]
    item: Any
    setup: Setup


@dataclass(frozen=True)
class Failure:
    """An exception, in parts that can be pickled whatever its constructor takes."""

    kind: type[BaseException]
    arguments: tuple[Any, ...]
    attributes: dict[str, Any]
    trace: str  #: the traceback in the worker

    @classmethod
    def of(cls, error: BaseException) -> Failure:
        """Return the parts of `error`; one that cannot be pickled becomes a RuntimeError with the same text."""
        trace = "".join(traceback.format_exception(error))
        failure = cls(type(error), error.args, dict(vars(error)), trace)
        try:
            pickle.loads(pickle.dumps(failure)).error()  # noqa: S301 - our own bytes
        except Exception:  # noqa: BLE001 - whatever an odd class raises, the text of it still travels
            return cls(RuntimeError, (f"{type(error).__name__}: {error}",), {}, trace)
        return failure

    def error(self) -> BaseException:
        """Return the exception; its traceback in the worker is a note."""
        error = self.kind.__new__(self.kind, *self.arguments)
        error.args = self.arguments
        vars(error).update(self.attributes)
        error.add_note(f"in a worker:\n{self.trace}")
        return error


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of an item: a result, or a failure."""

    result: Any = None
    failure: Failure | None = None


def perform(work: Work) -> Outcome:
    """Do the work; an exception becomes part of the outcome."""
    try:
        work.setup.prepare()
        return Outcome(work.function(work.item))
    except Exception as error:  # noqa: BLE001 - it belongs to whoever asked for the item
        return Outcome(failure=Failure.of(error))


def perform_pickled(work: bytes) -> bytes:
    """Do work that was pickled, and return the outcome pickled."""
    try:
        outcome = perform(pickle.loads(work))  # noqa: S301 - from the process that started this one
    except Exception as error:  # noqa: BLE001 - a function that cannot be imported here
        outcome = Outcome(failure=Failure.of(error))
    try:
        return pickle.dumps(outcome)
    except Exception as error:  # noqa: BLE001 - a result that cannot be sent
        return pickle.dumps(Outcome(failure=Failure.of(error)))
