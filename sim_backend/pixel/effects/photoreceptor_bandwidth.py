"""Bandwidth of the photoreceptor."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["PhotoreceptorBandwidth"]


@dataclass(frozen=True, slots=True)
class PhotoreceptorBandwidth(Effect):
    """A first-order low-pass before the source follower, of corner ``min(hz_per_fa I, max_hz)``.

    I is the total photocurrent, dark current included, so the corner follows the light from moment to moment; below
    the dark limit it falls no further. Its latency is ``1 / (2 pi hz_per_fa I)``.

    Source: R. Graca, B. McReynolds, T. Delbruck, "Shining light on the DVS pixel: a tutorial and discussion about
    biasing and optimization", CVPR Workshops (2023).
    """

    id: ClassVar[str] = "photoreceptor_bandwidth"
    stage: ClassVar[Stage] = "photoreceptor"
    sign: ClassVar[str] = (
        "Responses are later and smaller at low light, much more so for short pulses; noise events get rare."
    )

    hz_per_fa: float = parameter("Hz/fA", (1e-4, math.inf), 5.0, math.inf, "corner per photocurrent")
    max_hz: float = parameter("Hz", (0.01, math.inf), 3000.0, math.inf, "highest corner")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this low-pass."""
        return replace(chain, receptor_hz_per_fa=self.hz_per_fa, receptor_max_hz=self.max_hz)
