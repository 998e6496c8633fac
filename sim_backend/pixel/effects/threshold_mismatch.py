"""Thresholds that differ from pixel to pixel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from sim_backend.pixel.chain import LOWEST_THRESHOLD
from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["ThresholdMismatch"]


@dataclass(frozen=True, slots=True)
class ThresholdMismatch(Effect):
    """Each pixel's thresholds are drawn once, ON and OFF independently: ``N(theta, sigma)``, but at least 0.01.

    The average response curve is broad while each pixel's own is steep.

    Source: P. Lichtsteiner, C. Posch, T. Delbruck, "A 128x128 120 dB 15 us latency asynchronous temporal contrast
    vision sensor", IEEE JSSC 43 (2008).
    """

    id: ClassVar[str] = "threshold_mismatch"
    stage: ClassVar[Stage] = "comparators"
    knows_light: ClassVar[bool] = False
    sign: ClassVar[str] = (
        "The average curve is broad while each pixel's own is steep; more pulses do not narrow the spread of pixels."
    )

    sigma_on: float = parameter("ln", (0.0, 1.0), 0.025, 0.0, "standard deviation of theta_on over the pixels")
    sigma_off: float = parameter("ln", (0.0, 1.0), 0.025, 0.0, "standard deviation of theta_off over the pixels")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:
        """Return the chain with each pixel's own thresholds."""
        on = chain.theta_on + self.sigma_on * draws.normal("threshold_mismatch.sigma_on")
        off = chain.theta_off + self.sigma_off * draws.normal("threshold_mismatch.sigma_off")
        return replace(
            chain,
            theta_on=np.maximum(on, LOWEST_THRESHOLD),
            theta_off=np.maximum(off, LOWEST_THRESHOLD),
        )
