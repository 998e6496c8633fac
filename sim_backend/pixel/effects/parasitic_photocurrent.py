"""Light that falls on the reset switch."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["ParasiticPhotocurrent"]


@dataclass(frozen=True, slots=True)
class ParasiticPhotocurrent(Effect):
    """A leak in proportion to the light: ``dD/dt = rate_per_s_per_lux E`` since the reset.

    E is all light on the chip, stray light included, at each moment.

    Source: Y. Nozaki, T. Delbruck, "Temperature and parasitic photocurrent effects in dynamic vision sensors", IEEE
    Transactions on Electron Devices 64 (2017).
    """

    id: ClassVar[str] = "parasitic_photocurrent"
    stage: ClassVar[Stage] = "change detector"
    sign: ClassVar[str] = "As with a leak, but in proportion to the light: ON noise events that grow with it."

    rate_per_s_per_lux: float = parameter("ln/(s lx)", (0.0, 10.0), 1e-3, 0.0, "rate per illuminance")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this leak."""
        return replace(chain, leak_per_s_per_lux=chain.leak_per_s_per_lux + self.rate_per_s_per_lux)
