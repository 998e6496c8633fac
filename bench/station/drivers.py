"""From the text of a station file to a driver's class, and a look at the arguments before it is made."""

from __future__ import annotations

import inspect
from difflib import get_close_matches
from importlib import import_module
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

__all__ = ["GROUP", "TOKENS", "DriverNotFound", "argument_problems", "find_driver"]

#: Entry-point group of drivers that other distributions bring.
GROUP: Final = "evs_bench.drivers"

#: Arguments that stand for something of the station.
TOKENS: Final = ("$world", "$clock", "$bias_map", "$true_bias_map")


class DriverNotFound(Exception):
    """A driver is named that is not there; the text says why."""


def find_driver(driver: str) -> type[Any]:
    """Return the class that ``package.module:Class`` or the name of an entry point stands for.

    Raises
    ------
    DriverNotFound
        It cannot be found or imported, or is no class.
    """
    found = _from_path(driver) if ":" in driver else _from_entry_point(driver)
    if not isinstance(found, type):
        raise DriverNotFound(f"{driver} is no class")
    return found


def _from_path(driver: str) -> object:
    module_name, _, class_name = driver.partition(":")
    try:
        module = import_module(module_name)
    except (ImportError, ValueError) as error:
        raise DriverNotFound(f"cannot import {module_name!r}: {error}") from None
    if not hasattr(module, class_name):
        raise DriverNotFound(f"module {module_name} has no {class_name!r}{_hint(class_name, vars(module))}")
    return getattr(module, class_name)


def _from_entry_point(driver: str) -> object:
    points = {point.name: point for point in entry_points(group=GROUP)}
    if driver not in points:
        raise DriverNotFound(
            f"there is no driver {driver!r}{_hint(driver, points)}; expected package.module:Class, "
            f"or the name of an installed driver ({', '.join(sorted(points)) or 'none is installed'})"
        )
    try:
        return points[driver].load()
    except (ImportError, AttributeError) as error:
        raise DriverNotFound(f"driver {driver!r} cannot be imported: {error}") from None


def argument_problems(cls: type[Any], args: Mapping[str, Any]) -> Iterator[tuple[str | None, str]]:
    """Yield what is wrong with the arguments for `cls`: the argument's name (None for those missing), and why."""
    parameters = inspect.signature(cls).parameters
    any_name = any(p.kind is p.VAR_KEYWORD for p in parameters.values())
    named = {name: p for name, p in parameters.items() if p.kind in (p.KEYWORD_ONLY, p.POSITIONAL_OR_KEYWORD)}
    for name, value in args.items():
        if name not in named and not any_name:
            yield name, f"unknown argument{_hint(name, named)}"
        elif isinstance(value, str) and value.startswith("$") and not _stands_for_something(value):
            yield name, f"{value} stands for nothing; known are {', '.join(TOKENS)}"
    missing = [name for name, p in named.items() if p.default is p.empty and name not in args]
    if missing:
        yield None, f"missing for {cls.__name__}: {', '.join(missing)}"


def _stands_for_something(value: str) -> bool:
    """Return whether an argument is a token, or a public name of the world."""
    token, _, name = value.partition(".")
    return token in TOKENS and (not name or (token == TOKENS[0] and name.isidentifier() and name[0] != "_"))


def _hint(name: str, known: Iterable[str]) -> str:
    close = get_close_matches(name, list(known), n=1)
    return f", did you mean {close[0]!r}?" if close else ""
