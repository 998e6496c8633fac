"""Error of the neutral-density filters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["NdError"]


@dataclass(frozen=True, slots=True)
class NdError(Effect):
    """A filter attenuates more than it says: ``E <- E 10^-delta_od`` while a filter is in the light path.

    It acts before stray light, which reaches the chip past the filter. A single number stands for whichever filter
    is in; the simulated bench has an error of its own for each of its filters as well.

    Source: the definition of optical density, ``transmission = 10^-OD``.
    """

    id: ClassVar[str] = "nd_error"
    stage: ClassVar[Stage] = "light"
    knows_light: ClassVar[bool] = False  #: by itself: it shows where another effect does
    sign: ClassVar[str] = (
        "Low-light curves jump where the filter goes in, if anything else depends on the absolute light."
    )

    delta_od: float = parameter("OD", (-3.0, 3.0), 0.05, 0.0, "true optical density minus the nominal one")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this error."""
        return replace(chain, nd_error_od=self.delta_od)
