"""Named, bounded physical parameters: how a model or an effect describes its numbers."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["Described", "Parameter", "parameter", "refuse_unknown", "unknown_name"]

_KEY = "parameter"


@dataclass(frozen=True, slots=True)
class Parameter:
    """What is to be known about one number of a model, apart from its value."""

    name: str
    unit: str  #: "1" for a pure number, "ln" for a natural logarithm of intensity
    bounds: tuple[float, float]  #: lowest and highest value allowed, both included
    default: float | None  #: None where the value may be left open; `doc` says what happens then
    null: float | None  #: value at which it has no influence; None if there is none
    doc: str


def parameter(unit: str, bounds: tuple[float, float], default: float | None, null: float | None, doc: str) -> Any:
    """Return a dataclass field that carries the description of a :class:`Parameter`."""
    description = Parameter("", unit, bounds, default, null, doc)
    return field(default=default, metadata={_KEY: description})


class Described:
    """A frozen dataclass whose fields made by :func:`parameter` are described and kept within their bounds."""

    __slots__ = ()

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """Return the description of each parameter, in the order of the fields."""
        found = []
        for item in fields(cls):  # type: ignore[arg-type]
            described = item.metadata.get(_KEY)
            if described is not None:
                found.append(
                    Parameter(
                        item.name,
                        described.unit,
                        described.bounds,
                        described.default,
                        described.null,
                        described.doc,
                    )
                )
        return tuple(found)

    def values(self) -> dict[str, float | None]:
        """Return the value of each parameter by name; None where it is left open."""
        return {p.name: getattr(self, p.name) for p in self.parameters()}

    def check_bounds(self, owner: str) -> None:
        """Raise :class:`InputError`, with a line for each value that is not a number within its bounds."""
        problems = [
            f"{owner}: {p.name} is {value!r}; expected a number from {p.bounds[0]:g} to {p.bounds[1]:g} {p.unit}"
            for p in self.parameters()
            if not (_within(value := getattr(self, p.name), p.bounds) or (value is None and p.default is None))
        ]
        if problems:
            raise InputError(*problems)


def _within(value: object, bounds: tuple[float, float]) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return not math.isnan(value) and bounds[0] <= value <= bounds[1]


def unknown_name(kind: str, name: str, known: Iterable[str]) -> str:
    """Return a line that says that `name` is not known, and which name may have been meant."""
    names = sorted(known)
    near = difflib.get_close_matches(str(name), names, n=1)
    advice = f"did you mean {near[0]}?" if near else f"known are {', '.join(names)}"
    return f"unknown {kind} {name!r}; {advice}"


def refuse_unknown(owner: str, names: Iterable[str], described: type[Described]) -> None:
    """Raise :class:`InputError`, with a line for each of `names` that is no parameter of `described`."""
    known = [p.name for p in described.parameters()]
    problems = [f"{owner}: {unknown_name('parameter', name, known)}" for name in names if name not in known]
    if problems:
        raise InputError(*problems)
