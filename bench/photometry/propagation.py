"""Standard errors carried through a formula, with the part of each number that goes in."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

__all__ = ["Known", "Propagated", "propagate"]

_STEP: Final = 1e-4  #: of a number, for its derivative, where it has no error of its own
_SHARE: Final = 0.1  #: of a standard error, for the derivative


@dataclass(frozen=True, slots=True)
class Known:
    """A number with its standard error; 0 for one that is taken to be exact."""

    value: float
    sd: float = 0.0


@dataclass(frozen=True, slots=True)
class Propagated:
    """A result, its standard error, and what each number that went in adds to that."""

    value: float
    sd: float
    parts: dict[str, float]  #: by name: the derivative times the standard error, signed

    @property
    def known(self) -> Known:
        """The result, to go into another formula."""
        return Known(self.value, self.sd)


def propagate(formula: Callable[..., float], inputs: Mapping[str, Known]) -> Propagated:
    """Carry independent errors through a formula, to first order (GUM, JCGM 100:2008, 5.1.2).

    Parameters
    ----------
    formula
        Takes the numbers in their order.
    inputs
        The numbers by name.

    Examples
    --------
    >>> propagate(lambda a, b: a * b, {"a": Known(2.0, 0.1), "b": Known(3.0, 0.2)}).sd
    0.5
    """
    values = [one.value for one in inputs.values()]
    parts = {}
    for i, (name, one) in enumerate(inputs.items()):
        step = _SHARE * one.sd or _STEP * abs(one.value) or _STEP
        up, down = (formula(*values[:i], one.value + s * step, *values[i + 1 :]) for s in (1.0, -1.0))
        parts[name] = round((up - down) / (2.0 * step) * one.sd, 15)
    return Propagated(formula(*values), round(math.hypot(*parts.values()), 15), parts)
