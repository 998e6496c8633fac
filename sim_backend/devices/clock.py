"""The world's clock, as a station asks for it."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim_backend.world import OpticalBench

__all__ = ["SimulatedClock"]


class SimulatedClock:
    """The virtual clock of a world: waiting takes no time.

    Parameters
    ----------
    world
        Whose clock it is.
    """

    def __init__(self, world: OpticalBench) -> None:
        self._clock = world.clock

    def now(self) -> float:
        """Return the seconds since the world began."""
        return self._clock.now()

    def sleep(self, seconds: float) -> None:
        """Let `seconds` pass in the world; a negative time raises `ValueError`."""
        self._clock.sleep(seconds)
