"""Dead times that differ from pixel to pixel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["RefractoryMismatch"]


@dataclass(frozen=True, slots=True)
class RefractoryMismatch(Effect):
    """Each pixel's dead time is ``period exp(spread z)``, z standard normal and drawn once.

    Log-normal, because the current that sets it is the exponential of a voltage with a Gaussian error; the common
    period is its median.

    Source: M. J. M. Pelgrom, A. C. J. Duinmaijer, A. P. G. Welbers, "Matching properties of MOS transistors", IEEE
    JSSC 24 (1989).
    """

    id: ClassVar[str] = "refractory_mismatch"
    stage: ClassVar[Stage] = "refractory"
    knows_light: ClassVar[bool] = False
    sign: ClassVar[str] = (
        "The number of events of a large step, and their shortest interval, differ from pixel to pixel."
    )

    spread: float = parameter("1", (0.0, 3.0), 0.2, 0.0, "standard deviation of ln(period) over the pixels")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:
        """Return the chain with each pixel's own dead time."""
        factor = np.exp(self.spread * draws.normal("refractory_mismatch.spread"))
        return replace(chain, refractory_s=chain.refractory_s * factor)
