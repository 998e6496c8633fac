"""Error of the contrast axis."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["ContrastError"]


@dataclass(frozen=True, slots=True)
class ContrastError(Effect):
    """The true log contrast is not the commanded one: ``ln(E / E_0) <- (1 + gain_error) ln(E / E_0)``.

    `E_0` is the first level of the recording that is not dark, the baseline from which the pulses start; a dark
    level stays dark. It cannot be told from thresholds and noise scaled together while those are free: it counts
    only where the thresholds are known.

    Source: the definition of a light source whose response is a power of its command.
    """

    id: ClassVar[str] = "contrast_error"
    stage: ClassVar[Stage] = "light"
    knows_light: ClassVar[bool] = False
    sign: ClassVar[str] = "All curves are stretched along the contrast axis by the same factor, at every light."

    gain_error: float = parameter("1", (-0.9, 9.0), 0.05, 0.0, "relative error of the log contrast")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this error."""
        return replace(chain, contrast_gain=1.0 + self.gain_error)
