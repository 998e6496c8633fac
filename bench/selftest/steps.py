"""What a step of the self test is, and how it came out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from drivers.errors import DeviceError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

__all__ = ["Outcome", "Step", "carry_out"]

Outcome = Literal["good", "look", "bad"]


@dataclass(frozen=True, slots=True)
class Step:
    """One thing that was looked at."""

    role: str  #: light, wheel or camera
    what: str
    outcome: Outcome  #: "look": a person should judge it
    found: str  #: what was measured
    expected: str = ""


def carry_out(role: str, what: str, test: Callable[[], Iterator[Step]]) -> list[Step]:
    """Return what a test finds; a device that fails in it is one more step, and the other tests go on."""
    found: list[Step] = []
    try:
        found.extend(test())
    except DeviceError as error:
        found.append(Step(role, what, "bad", str(error)))
    return found
