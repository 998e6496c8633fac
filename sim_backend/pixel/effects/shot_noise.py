"""Shot noise of the photocurrent."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["ShotNoise"]


@dataclass(frozen=True, slots=True)
class ShotNoise(Effect):
    """White noise on u of variance ``factor q / (I dt)`` in a sample of length dt, before the photoreceptor.

    Charges arrive one by one: a current I has the two-sided spectral density ``q I``, and ``u = ln I`` turns it
    into ``q / I``. Behind a low-pass of time constant tau the variance is ``factor q / (2 I tau)``; with a
    photoreceptor whose corner is ``c I`` it is ``factor pi c q``, the same at every light.

    A pixel without dark current has no bound to it in the dark: give the model a dark current as well.

    Source: R. Graca, T. Delbruck, "Unraveling the paradox of intensity-dependent DVS pixel noise", International
    Image Sensor Workshop (2021); W. Schottky, Annalen der Physik 57 (1918).
    """

    id: ClassVar[str] = "shot_noise"
    stage: ClassVar[Stage] = "photocurrent"
    sign: ClassVar[str] = "Noise events and broadened curves that grow as the light falls, in both polarities."

    factor: float = parameter("1", (0.0, 100.0), 1.0, 0.0, "power relative to Poisson")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this noise."""
        return replace(chain, shot_factor=self.factor)
