"""What effects do to a pixel beyond numbers of the chain: functions at stages of the chain."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import TYPE_CHECKING, Any, Final

from protocols.errors import InputError
from protocols.user_module import failure

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim_backend.pixel.chain import Chain
    from sim_backend.pixel.effects.base import Effect

__all__ = ["COMPILED", "HOOKS", "Hook", "Hooks", "called", "has_hooks", "refused", "with_hooks"]

#: Hooks that are compiled, because they are called for samples or events of single pixels.
COMPILED: Final = ("response", "receptor_hz", "noise_rms", "leak", "thresholds", "refractory")
#: All hooks: one at each stage, in the order in which a signal passes them.
HOOKS: Final = ("light", *COMPILED, "events")


@dataclass(frozen=True, slots=True)
class Hook:
    """A function at one stage of the chain."""

    effect_id: str
    place: str  #: file and line of the function
    function: Callable[..., Any]  #: its first argument is `parameters`
    parameters: Any  #: named tuple of numbers where the function is compiled, else the effect

    @property
    def named(self) -> Any:
        """The type of `parameters`, the same for all effects of a class."""
        return type(self.parameters)

    def __str__(self) -> str:
        """Return where it stands, and which it is."""
        return f"{self.place}: effect {self.effect_id}: {self.function.__name__}"


@dataclass(frozen=True, slots=True)
class Hooks:
    """All functions, by the stage at which they act; several at one stage act one after the other.

    Each is the method of :class:`~sim_backend.pixel.effects.base.Effect` of that name.
    """

    light: tuple[Hook, ...] = ()
    response: tuple[Hook, ...] = ()
    receptor_hz: tuple[Hook, ...] = ()
    noise_rms: tuple[Hook, ...] = ()
    leak: tuple[Hook, ...] = ()
    thresholds: tuple[Hook, ...] = ()
    refractory: tuple[Hook, ...] = ()
    events: tuple[Hook, ...] = ()

    def __bool__(self) -> bool:
        """Return whether there is any."""
        return any(getattr(self, f.name) for f in fields(self))

    @property
    def compiled(self) -> bool:
        """Whether there is one that acts on the dynamics of single pixels."""
        return any(getattr(self, name) for name in COMPILED)


def has_hooks(chain: Chain) -> bool:
    """Return whether functions act on the chain's pixels: then only the reference engine knows what they do."""
    return bool(chain.hooks)


def with_hooks(hooks: Hooks, effect: Effect) -> Hooks:
    """Return `hooks` and, behind them, those of `effect`."""
    return replace(hooks, **{name: (*getattr(hooks, name), _hook(effect, name)) for name in effect.hooks()})


def called(hook: Hook, *args: Any) -> Any:
    """Return what a hook that is not compiled gives.

    Raises
    ------
    InputError
        It raises an error itself; the message names the line in the user's file.
    """
    try:
        return hook.function(hook.parameters, *args)
    except Exception as error:
        raise InputError(failure(error, hook.function.__code__.co_filename, str(hook))) from error


def refused(hook: Hook, value: str, expected: str) -> InputError:
    """Return the error that a hook gave a value that cannot be used."""
    return InputError(f"{hook} gave {value}; expected {expected}")


def _hook(effect: Effect, name: str) -> Hook:
    function = getattr(type(effect), name)
    place = f"{function.__code__.co_filename}:{function.__code__.co_firstlineno}"
    return Hook(effect.id, place, function, _numbers(effect) if name in COMPILED else effect)


def _numbers(effect: Effect) -> tuple[float, ...]:
    """Return the parameters as a named tuple, which a compiled function reads as it would read the effect."""
    values = [float("nan") if value is None else float(value) for value in effect.values().values()]
    cls: Any = type(effect)
    named: tuple[float, ...] = _tuple_of(cls)(*values)
    return named


@cache
def _tuple_of(cls: Any) -> Any:
    """Return one type for each class: compiled code is for the type, whatever the numbers."""
    return namedtuple(cls.__name__, [p.name for p in cls.parameters()])
