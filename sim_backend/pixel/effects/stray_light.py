"""Light on the chip that does not come from the source."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["StrayLight"]


@dataclass(frozen=True, slots=True)
class StrayLight(Effect):
    """Constant light that reaches the chip past source and ND filter: ``E <- E + E_stray``.

    In the pixel it is the same as a dark current of ``k E_stray``; only temperature or a lens cap tells them apart.

    Source: the definition of light that passes neither source nor filter.
    """

    id: ClassVar[str] = "stray_light"
    stage: ClassVar[Stage] = "light"
    sign: ClassVar[str] = (
        "The response curve moves to higher contrast as the light falls, as with a dark current of k E_stray."
    )

    illuminance_lux: float = parameter("lx", (0.0, 1e5), 0.05, 0.0, "illuminance on the chip with the source off")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this light added."""
        return replace(chain, stray_lux=chain.stray_lux + self.illuminance_lux)
