"""Ripple of the light source."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["LightFlicker"]


@dataclass(frozen=True, slots=True)
class LightFlicker(Effect):
    """A ripple on the light: ``E <- E (1 + depth sin(2 pi f t + phase))``.

    Lamps on the mains have it at 100 or 120 Hz, dimmed light-emitting diodes at the frequency of their dimmer. The
    recording does not start at a known phase of it: where `phase` is left open, each recording has its own, drawn
    from its seed.

    What pixels memorise at the start is the light of that moment, unless `settled_hz` is given: then they have
    settled to a ripple that had gone on before, behind a low-pass of that corner. The source follower's is that of a
    lamp that was on all the time; a very low one that of a ripple that begins with the recording.

    Source: the definition of a sinusoidal ripple; t is the time in the recording. A low-pass of corner c leaves
    ``cos(a) sin(phase - a)`` of ``sin(phase)``, with ``tan(a) = f / c``.
    """

    id: ClassVar[str] = "light_flicker"
    stage: ClassVar[Stage] = "light"
    knows_light: ClassVar[bool] = False
    sign: ClassVar[str] = (
        "Events are locked to a phase that has nothing to do with the pulses; curves move left, as with noise."
    )

    depth: float = parameter("1", (0.0, 1.0), 0.05, 0.0, "amplitude relative to the mean")
    frequency_hz: float = parameter("Hz", (0.01, 2e4), 100.0, None, "frequency")
    phase: float | None = parameter("rad", (0.0, 6.2832), None, None, "phase at t = 0; open: free in each recording")
    settled_hz: float | None = parameter(
        "Hz", (1e-3, 1e6), None, None, "corner behind which pixels had settled at t = 0; open: to the light of t = 0"
    )

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this ripple."""
        if self.depth == 0.0:
            return chain
        return replace(
            chain,
            flicker_depth=self.depth,
            flicker_hz=self.frequency_hz,
            flicker_phase=self.phase,
            flicker_settled_hz=math.inf if self.settled_hz is None else self.settled_hz,
        )
