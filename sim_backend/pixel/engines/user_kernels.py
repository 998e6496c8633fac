"""Functions that a user wrote in plain Python, compiled, and called by the kernel through their address.

So the kernel is compiled once for all functions, and may be kept on disk; a user's function is compiled in each
process that uses it and never kept: a changed file cannot meet machine code from before. Parameters are handed over
at each call, as an array, so that another value needs no other code.
"""

from __future__ import annotations

import dis
import re
from functools import cache
from types import FunctionType
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numba.core import types
from numba.core.errors import NumbaError
from numba.np.unsafe.ndarray import to_fixed_tuple

from drivers.jit import cfunc, njit
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from sim_backend.pixel.hooks import Hook

    Function = Callable[..., Any]

_NUMBER: Final = types.float64
_PAIR: Final = types.UniTuple(_NUMBER, 2)  # type: ignore[no-untyped-call]
_PARAMETERS: Final = types.Array(_NUMBER, 1, "C")
#: What the kernel calls, by the hook: parameters and plain numbers in, numbers out.
_OF_TWO: Final = _NUMBER(_PARAMETERS, _NUMBER, _NUMBER)
_OF_THREE: Final = _NUMBER(_PARAMETERS, *[_NUMBER] * 3)
_THRESHOLDS: Final = _PAIR(_PARAMETERS, *[_NUMBER] * 5)
#: What numba adds to its reasons: colours, the pass it was in, the place.
_COLOUR: Final = re.compile(r"\x1b\[[0-9;]*m")
_NO_REASON: Final = re.compile(r"Failed in nopython|During: |File |No implementation of function|\s*$")
_LINE: Final = re.compile(r'File "[^"]*", line (\d+)')


@cfunc(_OF_TWO, cache=True)
def _unchanged_of_two(_parameters, value, _current):  # type: ignore[no-untyped-def]
    return value


@cfunc(_OF_THREE, cache=True)
def _unchanged_of_three(_parameters, value, _current, _z):  # type: ignore[no-untyped-def]
    return value


@cfunc(_THRESHOLDS, cache=True)
def _unchanged_thresholds(_parameters, on, off, _current, _since_s, _z):  # type: ignore[no-untyped-def]
    return on, off


_to_tuple: Any = to_fixed_tuple  # the number of values must be a constant where it is compiled
_compile = njit(nogil=True, error_model="numpy")


def address(name: str, hooks: tuple[Hook, ...]) -> tuple[Any, Any]:
    """Return what the kernel calls for the hooks at one stage, and the array of their parameters.

    Raises
    ------
    InputError
        One cannot be compiled, or gives no number.
    """
    parameters = np.array([value for hook in hooks for value in hook.parameters], np.float64)
    if name == "thresholds":
        return (_thresholds(_in_turn(hooks, _behind_pairs)) if hooks else _unchanged_thresholds), parameters
    if name == "refractory":
        return (_of_three(_in_turn(hooks, _behind)) if hooks else _unchanged_of_three), parameters
    return (_of_two(_in_turn(hooks, _behind)) if hooks else _unchanged_of_two), parameters


def check(hook: Hook) -> None:
    """Raise :class:`InputError`, one line with file and line, if a hook cannot be compiled or gives no number."""
    if _raises(hook.function):
        raise InputError(f"{hook} raises an error, which a compiled function cannot; return nan to refuse a value")
    function = _compiled(hook.function)
    name = hook.function.__name__
    inputs = (function.typeof_pyval(hook.parameters), *[_NUMBER] * _numbers_of(name))
    try:
        function.compile(inputs)
    except (NumbaError, NotImplementedError) as error:
        raise InputError(f"{_at(hook, str(error))} cannot be compiled: {_reason(str(error))}") from None
    given = function.overloads[inputs].signature.return_type
    if not _fits(name, given):
        expected = "two numbers, ON and OFF," if name == "thresholds" else "a number"
        raise InputError(f"{hook} gives {given}; expected {expected} whatever it is given")


def _numbers_of(name: str) -> int:
    return {"thresholds": 5, "refractory": 3}.get(name, 2)


def _in_turn(hooks: tuple[Hook, ...], behind: Function) -> Any:
    """Return the function that lets each hook act on what the ones before gave; `behind` puts two together."""
    function, begin = None, 0
    for hook in hooks:
        check(hook)
        function = behind(function, _of_array(_compiled(hook.function), hook.named, begin))
        begin += len(hook.parameters)
    return function


@cache
def _of_array(function: Any, named: Any, begin: int) -> Any:
    """Return `function` of the parameters that stand in the array from `begin`, as the named tuple `named`."""
    count = len(named._fields)
    if count == 0:
        return _compile(lambda _, *numbers: function(named(), *numbers))

    def of_array(parameters, *numbers):  # type: ignore[no-untyped-def]
        return function(named(*_to_tuple(parameters[begin : begin + count], count)), *numbers)

    return _compile(of_array)


@cache
def _behind(first: Any, second: Any) -> Any:
    if first is None:
        return second
    return _compile(lambda parameters, value, *rest: second(parameters, first(parameters, value, *rest), *rest))


@cache
def _behind_pairs(first: Any, second: Any) -> Any:
    if first is None:
        return second

    def both(parameters, on, off, *rest):  # type: ignore[no-untyped-def]
        on, off = first(parameters, on, off, *rest)
        return second(parameters, on, off, *rest)

    return _compile(both)


@cache
def _of_two(function: Any) -> Any:
    return cfunc(_OF_TWO)(lambda parameters, value, current: function(parameters, value, current))


@cache
def _of_three(function: Any) -> Any:
    return cfunc(_OF_THREE)(lambda parameters, value, current, z: function(parameters, value, current, z))


@cache
def _thresholds(function: Any) -> Any:
    def both(parameters, on, off, current, since_s, z):  # type: ignore[no-untyped-def]
        on, off = function(parameters, on, off, current, since_s, z)
        return np.float64(on), np.float64(off)

    return cfunc(_THRESHOLDS)(both)


@cache
def _compiled(function: Function) -> Any:
    return _compile(_ready(function, ()))


@cache
def _raises(function: Function) -> bool:
    """Return whether `function`, or one that it calls, has a raise or an assert in it."""
    code = (step.opname for part in _with_helpers(function, ()) for step in dis.get_instructions(part))
    return "RAISE_VARARGS" in code


def _helpers(function: Function) -> dict[str, Function]:
    """Return the plain functions of its file that `function` calls, by name."""
    named = {name: function.__globals__.get(name) for name in function.__code__.co_names}
    return {name: helper for name, helper in named.items() if isinstance(helper, FunctionType)}


def _with_helpers(function: Function, callers: tuple[Function, ...]) -> list[Function]:
    """Return `function` and all that it calls."""
    if function in callers:
        return []
    called = [_with_helpers(helper, (*callers, function)) for helper in _helpers(function).values()]
    return [function, *(helper for helpers in called for helper in helpers)]


def _ready(function: Function, callers: tuple[Function, ...]) -> Function:
    """Return `function` as it can be compiled: with the plain functions of its file that it calls compiled."""
    helpers = {
        name: _compile(_ready(helper, (*callers, function)))
        for name, helper in _helpers(function).items()
        if helper not in (*callers, function)
    }
    if not helpers:
        return function
    names = {**function.__globals__, **helpers}
    return FunctionType(function.__code__, names, function.__name__, function.__defaults__, function.__closure__)


def _fits(name: str, given: Any) -> bool:
    if name == "thresholds":
        is_tuple = isinstance(given, types.BaseTuple)
        return is_tuple and _are_numbers(given.types, 2)
    return _are_numbers((given,), 1)


def _are_numbers(given: tuple[Any, ...], count: int) -> bool:
    return len(given) == count and all(isinstance(g, types.Float | types.Integer) for g in given)


def _reason(message: str) -> str:
    """Return the line of numba's message that says what is wrong."""
    lines = _COLOUR.sub("", message).splitlines()
    reason = next((line.strip() for line in lines if not _NO_REASON.match(line)), " ".join(lines))
    return reason.replace(">>> ", "there is no ")


def _at(hook: Hook, message: str) -> str:
    """Return the place that numba's message names, or that of the hook."""
    line = _LINE.search(_COLOUR.sub("", message))
    if line is None:
        return str(hook)
    return f"{hook.function.__code__.co_filename}:{line[1]}: effect {hook.effect_id}: {hook.function.__name__}"
