"""How a run behaves when something goes wrong: the counts that a protocol's policy is about."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from protocols.policy import Policy

if TYPE_CHECKING:
    from protocols.policy import OnBadPoint, OnFailure
    from protocols.suspend import Suspend

__all__ = ["BadPoints", "Conduct", "Failures"]


@dataclass(frozen=True, slots=True)
class Conduct:
    """What a protocol says of how its run is taken."""

    policy: Policy = field(default_factory=Policy)
    suspend: Suspend | None = None  #: what keeps the run from measuring
    dark_light_lux: float | None = None  #: equivalent dark light that the sensor is believed to have


class Failures:
    """The failures of one point.

    Parameters
    ----------
    policy
        How often a point is tried again.
    """

    def __init__(self, policy: OnFailure) -> None:
        self._retries = policy.retries
        self._used = 0

    def again(self) -> bool:
        """Count a failure, and return whether the point is tried again."""
        self._used += 1
        return self._used <= self._retries

    def forgive(self) -> None:
        """Begin to count anew: the operator has seen to it."""
        self._used = 0


class BadPoints:
    """The points of a run that are judged bad.

    Parameters
    ----------
    policy
        How often each, and all of them together, are taken again.
    """

    def __init__(self, policy: OnBadPoint) -> None:
        self._policy = policy
        self._left = policy.budget
        self._used: dict[int, int] = {}

    def again(self, index: int) -> bool:
        """Count a bad one, and return whether the point `index` is taken again."""
        used = self._used.get(index, 0)
        if used >= self._policy.retries or not self._left:
            return False
        self._used[index] = used + 1
        self._left -= 1
        return True

    @property
    def are_skipped(self) -> bool:
        """Whether one that is not taken again is left out."""
        return self._policy.then == "skip"
