"""Ready-made protocols, as YAML files beside this module."""

from __future__ import annotations

from importlib.resources import files

from protocols.errors import InputError

__all__ = ["names", "text"]


def names() -> tuple[str, ...]:
    """Return the names of the ready-made protocols, in alphabetical order."""
    found = (entry.name for entry in files("protocols.library").iterdir())
    return tuple(sorted(name.removesuffix(".yaml") for name in found if name.endswith(".yaml")))


def text(name: str) -> str:
    """Return a ready-made protocol as it is written.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if name not in names():
        raise InputError(f"there is no ready-made protocol {name!r}; there are {', '.join(names())}")
    return files("protocols.library").joinpath(f"{name}.yaml").read_text(encoding="utf-8")
