"""The camera's event-rate controller."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["EventRateLimit"]


@dataclass(frozen=True, slots=True)
class EventRateLimit(Effect):
    """In each period ``max_rate_eps period_s`` events pass; where there are more, which ones do is random.

    Periods count from the start of the recording. A limit that is not a whole number for a period is one on
    average. It is the last stage: it acts on what the trail filter lets through.

    Source: Prophesee, OpenEB 5.1.1, event-rate controller of the IMX636 (20 million events per second over 200 us).
    """

    id: ClassVar[str] = "event_rate_limit"
    stage: ClassVar[Stage] = "readout"
    knows_light: ClassVar[bool] = False
    sign: ClassVar[str] = (
        "Plateaus below 1 where many pixels answer within a period, alike in all pixels and without added latency."
    )

    max_rate_eps: float = parameter("1/s", (1.0, math.inf), 2e7, math.inf, "events that pass per second")
    period_s: float = parameter("s", (1e-6, 0.1), 2e-4, None, "period in which events are counted")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this limit."""
        if self.max_rate_eps == math.inf:
            return chain
        return replace(chain, limit_eps=self.max_rate_eps, limit_period_s=self.period_s)
