"""Slow noise of the pixel's amplifiers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["LowFrequencyNoise"]


@dataclass(frozen=True, slots=True)
class LowFrequencyNoise(Effect):
    """Ornstein-Uhlenbeck noise added to V: Gaussian, of this rms, with the correlation ``exp(-t / tau)``.

    It stands for 1/f noise in the band that a recording sees, and starts at its stationary law.

    Source: G. E. Uhlenbeck, L. S. Ornstein, "On the theory of the Brownian motion", Physical Review 36 (1930).
    """

    id: ClassVar[str] = "low_frequency_noise"
    stage: ClassVar[Stage] = "source follower"
    knows_light: ClassVar[bool] = False
    sign: ClassVar[str] = "Slow events in runs, correlated over seconds."

    rms: float = parameter("ln", (0.0, 1.0), 0.03, 0.0, "standard deviation")
    tau_s: float = parameter("s", (1e-4, 1e4), 1.0, None, "correlation time")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this noise."""
        if self.rms == 0.0:
            return chain
        return replace(chain, slow_rms=self.rms, slow_tau_s=self.tau_s)
