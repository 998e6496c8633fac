"""Events that are copied into a neighbour."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["Crosstalk"]


@dataclass(frozen=True, slots=True)
class Crosstalk(Effect):
    """An event makes one of the four direct neighbours, at random, emit the same polarity with this probability.

    The copy comes within 10 us, uniformly. It is a copy only: the neighbour's state does not change, it is not
    copied again, and it is lost outside the window.

    Source: the definition of a coupling between neighbours in its first order.
    """

    id: ClassVar[str] = "crosstalk"
    stage: ClassVar[Stage] = "readout"
    knows_light: ClassVar[bool] = False
    sign: ClassVar[str] = "Pairs of events of one polarity in neighbours within 10 us, more often than chance."

    probability: float = parameter("1", (0.0, 1.0), 0.01, 0.0, "that an event is copied")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this coupling."""
        return replace(chain, crosstalk=self.probability)
