"""Dark current of the photodiode."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["DarkCurrent"]


@dataclass(frozen=True, slots=True)
class DarkCurrent(Effect):
    """A current that flows without light: ``I = k E + I_dark``.

    ``I_dark = mean_fa exp(spread z - spread^2 / 2)`` with a standard normal `z` for each pixel: log-normal over the
    pixels, with `mean_fa` as its mean whatever the spread. It moves the whole response curve to higher contrast as
    the light falls, because a step of the light is a smaller step of the total current.

    Source: R. Graca, B. McReynolds, T. Delbruck, "Shining light on the DVS pixel: a tutorial and discussion about
    biasing and optimization", CVPR Workshops (2023).
    """

    id: ClassVar[str] = "dark_current"
    stage: ClassVar[Stage] = "photocurrent"
    sign: ClassVar[str] = "The response curve moves to higher contrast as the light falls; nothing at high light."

    mean_fa: float = parameter("fA", (0.0, 1e4), 5.0, 0.0, "mean over the pixels")
    spread: float = parameter("1", (0.0, 3.0), 0.0, 0.0, "standard deviation of ln(I_dark) over the pixels")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:
        """Return the chain with this current added in each pixel."""
        z = draws.normal("dark_current.mean_fa")
        dark_fa = self.mean_fa * np.exp(self.spread * z - 0.5 * self.spread**2)
        return replace(chain, dark_fa=chain.dark_fa + dark_fa)
