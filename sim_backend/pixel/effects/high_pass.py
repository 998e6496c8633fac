"""Adaptation of the pixel to a lasting signal."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["HighPass"]


@dataclass(frozen=True, slots=True)
class HighPass(Effect):
    """A first-order high-pass on V: ``V <- V - L`` with ``dL/dt = 2 pi corner_hz (V - L)``.

    The response to a step fades as ``exp(-2 pi corner_hz t)``, and its end answers with the opposite polarity.
    Cameras with a bias for it call that bias_hpf.

    Source: the first-order high-pass; Prophesee, "Biases", Metavision documentation (bias_hpf).
    """

    id: ClassVar[str] = "high_pass"
    stage: ClassVar[Stage] = "change detector"
    knows_light: ClassVar[bool] = False
    sign: ClassVar[str] = (
        "The response to slow stimuli fades, and the end of a long pulse is answered by the opposite polarity."
    )

    corner_hz: float = parameter("Hz", (0.0, 1e5), 1.0, 0.0, "corner")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this high-pass."""
        return replace(chain, high_pass_hz=self.corner_hz)
