"""Rise time of the light source."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["LightRiseTime"]


@dataclass(frozen=True, slots=True)
class LightRiseTime(Effect):
    """The light follows its command as a first-order low-pass: ``dE/dt = (E_commanded - E) / tau``.

    10 % to 90 % of an edge take ``ln(9) tau = 2.2 tau``. Latencies grow by the same amount at every light.

    Source: the first-order response of a driver with one time constant.
    """

    id: ClassVar[str] = "light_rise_time"
    stage: ClassVar[Stage] = "light"
    knows_light: ClassVar[bool] = False
    sign: ClassVar[str] = "Latencies grow at every light by the same amount, more for small contrasts."

    tau_s: float = parameter("s", (0.0, 10.0), 5e-4, 0.0, "time constant")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this rise time."""
        return replace(chain, rise_tau_s=self.tau_s)
