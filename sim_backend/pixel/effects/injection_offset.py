"""Charge that the reset switch injects."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["InjectionOffset"]


@dataclass(frozen=True, slots=True)
class InjectionOffset(Effect):
    """Each reset memorises too high a level: ``V_ref = V + offset``, the start of the recording included.

    The distance to an ON event is ``theta_on + offset``, to an OFF event ``theta_off - offset``. It cannot be told
    from other thresholds while those are free: it counts only where the thresholds are known.

    Source: P. Lichtsteiner, C. Posch, T. Delbruck, "A 128x128 120 dB 15 us latency asynchronous temporal contrast
    vision sensor", IEEE JSSC 43 (2008).
    """

    id: ClassVar[str] = "injection_offset"
    stage: ClassVar[Stage] = "change detector"
    knows_light: ClassVar[bool] = False
    sign: ClassVar[str] = "ON and OFF curves move in opposite directions, by the same amount at every light."

    offset: float = parameter("ln", (-1.0, 1.0), 0.02, 0.0, "memorised level above the signal")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this offset."""
        return replace(chain, injection_ln=chain.injection_ln + self.offset)
