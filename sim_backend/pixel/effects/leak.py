"""Leakage of the change detector's reset switch."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["Leak"]


@dataclass(frozen=True, slots=True)
class Leak(Effect):
    """The memorised level sinks: ``D = V - V_ref + rate (t - t_reset)``.

    A pixel at rest has an ON event every ``theta_on / rate``, plus the dead time. The rate is log-normal over the
    pixels, ``rate_per_s exp(spread z)`` with a standard normal z for each: `rate_per_s` is its median.

    Source: Y. Nozaki, T. Delbruck, "Temperature and parasitic photocurrent effects in dynamic vision sensors", IEEE
    Transactions on Electron Devices 64 (2017).
    """

    id: ClassVar[str] = "leak"
    stage: ClassVar[Stage] = "change detector"
    knows_light: ClassVar[bool] = False
    sign: ClassVar[str] = (
        "ON noise events without stimulus and none OFF; the ON curve moves left, the OFF curve right, at every light."
    )

    rate_per_s: float = parameter("ln/s", (0.0, 1e3), 0.05, 0.0, "median over the pixels")
    spread: float = parameter("1", (0.0, 3.0), 0.0, 0.0, "standard deviation of ln(rate) over the pixels")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:
        """Return the chain with each pixel's leak."""
        rate = self.rate_per_s * np.exp(self.spread * draws.normal("leak.rate_per_s"))
        return replace(chain, leak_per_s=chain.leak_per_s + rate)
