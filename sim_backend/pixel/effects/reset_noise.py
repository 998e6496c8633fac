"""Thermal noise that the reset switch freezes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["ResetNoise"]


@dataclass(frozen=True, slots=True)
class ResetNoise(Effect):
    """Each reset memorises a level of its own: ``V_ref = V + N(0, rms)``, the start of the recording included.

    Opening the switch freezes the thermal noise of the capacitor, ``kT / C``; between two resets nothing moves.

    Source: D. Joubert, A. Marcireau, N. Ralph, A. Jolley, A. van Schaik, G. Cohen, "Event camera simulator
    improvements via characterized parameters", Frontiers in Neuroscience 15 (2021).
    """

    id: ClassVar[str] = "reset_noise"
    stage: ClassVar[Stage] = "change detector"
    knows_light: ClassVar[bool] = False
    sign: ClassVar[str] = "Curves are broader at every light, even at low bandwidth, but there are few noise events."

    rms: float = parameter("ln", (0.0, 1.0), 0.02, 0.0, "standard deviation")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this noise."""
        return replace(chain, reset_rms=self.rms)
