"""Time stamps that scatter."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["TimestampJitter"]


@dataclass(frozen=True, slots=True)
class TimestampJitter(Effect):
    """Each time stamp has a Gaussian error of its own: ``t <- t + N(0, sigma)``; then the events are sorted again.

    An event that is stamped outside the recording is not in it.

    Source: the definition of a jitter.
    """

    id: ClassVar[str] = "timestamp_jitter"
    stage: ClassVar[Stage] = "readout"
    knows_light: ClassVar[bool] = False
    sign: ClassVar[str] = "Latencies scatter by the same amount at every light and contrast."

    sigma_s: float = parameter("s", (0.0, 0.1), 2e-5, 0.0, "standard deviation")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this jitter."""
        return replace(chain, jitter_s=self.sigma_s)
