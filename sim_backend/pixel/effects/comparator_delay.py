"""Time that the comparators need."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["ComparatorDelay"]


@dataclass(frozen=True, slots=True)
class ComparatorDelay(Effect):
    """An event is stamped, and the pixel's dead time starts, ``delay_s`` after the crossing.

    The comparator has decided at the crossing: what the signal does in the meantime no longer matters to this
    event.

    Source: D. Joubert, A. Marcireau, N. Ralph, A. Jolley, A. van Schaik, G. Cohen, "Event camera simulator
    improvements via characterized parameters", Frontiers in Neuroscience 15 (2021).
    """

    id: ClassVar[str] = "comparator_delay"
    stage: ClassVar[Stage] = "comparators"
    knows_light: ClassVar[bool] = False
    sign: ClassVar[str] = "All latencies grow by the same amount, at every light and contrast."

    delay_s: float = parameter("s", (0.0, 1.0), 2e-5, 0.0, "from the crossing to the event")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this delay."""
        return replace(chain, comparator_delay_s=self.delay_s)
