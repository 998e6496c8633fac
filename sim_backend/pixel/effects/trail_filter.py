"""The camera's filter against trails of events."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["TrailFilter"]


@dataclass(frozen=True, slots=True)
class TrailFilter(Effect):
    """Only the first event of a run of one polarity in a pixel passes.

    A run ends with an event of the other polarity, or with `window_s` without an event; events that are held back
    prolong it. It acts on sorted time stamps, before the rate limit.

    Source: Prophesee, "Event signal processing", Metavision documentation (event trail filter).
    """

    id: ClassVar[str] = "trail_filter"
    stage: ClassVar[Stage] = "readout"
    knows_light: ClassVar[bool] = False
    sign: ClassVar[str] = (
        "A pulse has at most one event of its polarity in a pixel; the later ones of a large step vanish."
    )

    window_s: float = parameter("s", (0.0, 10.0), 1e-2, 0.0, "time without an event that ends a run")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this filter."""
        return replace(chain, trail_s=self.window_s)
