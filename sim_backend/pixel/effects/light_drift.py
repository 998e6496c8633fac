"""Slow change of the light source."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["LightDrift"]


@dataclass(frozen=True, slots=True)
class LightDrift(Effect):
    """The light changes in proportion to time: ``E <- E (1 + rate t)``, t from the start of the recording.

    It starts anew with each recording, and is not brighter than none at all: where ``1 + rate t`` is below 0 the
    light is off.

    Source: the first term of the expansion of a lamp that warms up or ages.
    """

    id: ClassVar[str] = "light_drift"
    stage: ClassVar[Stage] = "light"
    knows_light: ClassVar[bool] = False
    sign: ClassVar[str] = (
        "ON (falling light: OFF) background events, like a leak of that rate, where it is well above the dark light."
    )

    rate_per_s: float = parameter("1/s", (-1.0, 1.0), 1e-3, 0.0, "relative change of the light per second")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this drift."""
        return replace(chain, drift_per_s=self.rate_per_s)
