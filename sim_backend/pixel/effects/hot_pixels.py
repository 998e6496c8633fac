"""Pixels that fire by themselves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["HotPixels"]


@dataclass(frozen=True, slots=True)
class HotPixels(Effect):
    """A `fraction` of the pixels also emits ON events of their own, at random times (Poisson) at `rate_hz`.

    Which pixels these are belongs to the sensor. The events come on top of those of the change detector, which
    knows nothing of them.

    Source: Y. Hu, S.-C. Liu, T. Delbruck, "v2e: from video frames to realistic DVS events", CVPR Workshops (2021).
    """

    id: ClassVar[str] = "hot_pixels"
    stage: ClassVar[Stage] = "readout"
    knows_light: ClassVar[bool] = False
    sign: ClassVar[str] = "A few pixels fire ON events at every setting, even in the dark."

    fraction: float = parameter("1", (0.0, 1.0), 1e-3, 0.0, "share of the pixels")
    rate_hz: float = parameter("Hz", (0.0, 1e5), 50.0, 0.0, "events per second of a hot pixel")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:
        """Return the chain with these pixels."""
        hot = draws.uniform("hot_pixels.fraction") < self.fraction
        return replace(chain, hot_hz=chain.hot_hz + np.where(hot, self.rate_hz, 0.0))
