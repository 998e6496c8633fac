"""Effects of a user's own: loading the one file that was named, and looking at the classes in it."""

from __future__ import annotations

import inspect
import re
from dataclasses import dataclass, fields
from pathlib import Path
from types import FunctionType
from typing import TYPE_CHECKING, Any, Final

from protocols.errors import InputError, Problem
from protocols.user_module import classes_of, place_of, run_file, sha256_of
from sim_backend.pixel.effects.base import STAGES, Effect
from sim_backend.pixel.hooks import COMPILED, HOOKS, Hooks, with_hooks

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator

__all__ = ["EffectSource", "check_effect_class", "read_effect_file"]

_ID: Final = re.compile(r"[a-z][a-z0-9_]*")


@dataclass(frozen=True, slots=True)
class EffectSource:
    """Where effects came from that are not built in."""

    name: str  #: the file as it was named, or the name of the entry point
    loaded: str  #: how: "file" or "entry point"
    sha256: str  #: of the file that holds the classes; empty where it cannot be found
    classes: tuple[type[Effect], ...]
    package: str = ""  #: name and version of the package that brings an entry point
    path: str = ""  #: of a file, in full
    text: str = ""  #: of a file

    @property
    def ids(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(cls.id for cls in self.classes)


def read_effect_file(path: str | os.PathLike[str]) -> EffectSource:
    """Run the Python file `path`, and return the effects that it defines. No other file is looked at.

    A compiled hook is compiled here, so that what is wrong with it is told before anything is switched on.

    Raises
    ------
    InputError
        The file cannot be read or run, has no effect in it, or one that cannot be used; one line with file and line.
    """
    source = str(path)
    module, text = run_file(path, "effects")
    effects = classes_of(module, Effect)
    if not effects:
        raise InputError(Problem("has no effect in it; expected a class derived from Effect", source))
    for cls in effects:
        check_effect_class(cls, place_of(cls, source))
        _compile_hooks(cls)
    where = Path(path).resolve()
    return EffectSource(source, "file", sha256_of(where), effects, path=str(where), text=text)


def check_effect_class(cls: type[Effect], place: str) -> None:
    """Raise :class:`InputError` if `cls` cannot be used as an effect; `place` is where it stands.

    It is looked at as a class and made once with all defaults and once at its null value.
    """
    problem = next(_problems(cls), None)
    if problem is not None:
        raise InputError(f"{place}: {problem}")
    try:
        for effect in (cls(), cls.null()):
            effect.check_bounds(f"effect {cls.id}")
    except InputError as error:
        raise InputError(*(f"{place}: {p.message}" for p in error.problems)) from None


def _problems(cls: type[Effect]) -> Iterator[str]:
    """Yield what is wrong with a class, each in words."""
    name = cls.__name__
    if not isinstance(getattr(cls, "id", None), str) or not _ID.fullmatch(cls.id):
        yield f"{name}: id is {getattr(cls, 'id', None)!r}; expected a name of small letters, digits and underscores"
    if getattr(cls, "stage", None) not in STAGES:
        yield f"{name}: stage is {getattr(cls, 'stage', None)!r}; expected one of {', '.join(STAGES)}"
    if "__dataclass_params__" not in vars(cls) or not vars(cls)["__dataclass_params__"].frozen:
        yield f"{name}: is no frozen dataclass; expected @dataclass(frozen=True, slots=True) above it"
        return
    described = {p.name for p in cls.parameters()}
    for field in fields(cls):  # type: ignore[arg-type]
        if field.name not in described or field.name.startswith("_"):
            yield f"{name}: field {field.name} is no parameter; expected {field.name}: float = parameter(...)"
        if field.name in HOOKS:
            yield f"{name}: {field.name} is the name of a hook; choose another for the parameter"
    yield from _problems_of_methods(cls)


def _problems_of_methods(cls: type[Effect]) -> Iterator[str]:
    if cls.apply is Effect.apply and not cls.hooks():
        yield f"{cls.__name__}: does nothing; expected apply or one of {', '.join(HOOKS)}"
    for method in ("apply", *cls.hooks()):
        function, expected = getattr(cls, method), getattr(Effect, method)
        if not isinstance(function, FunctionType) or _arguments(function) != _arguments(expected):
            yield f"{cls.__name__}: {method} takes other arguments; expected {method}({_names(expected)})"


def _arguments(function: Any) -> int:
    return len(inspect.signature(function).parameters)


def _names(function: Any) -> str:
    return ", ".join(inspect.signature(function).parameters)


def _compile_hooks(cls: type[Effect]) -> None:
    hooks = with_hooks(Hooks(), cls())
    if not hooks.compiled:
        return
    from sim_backend.pixel.engines.user_kernels import check

    for name in COMPILED:
        for hook in getattr(hooks, name):
            check(hook)
