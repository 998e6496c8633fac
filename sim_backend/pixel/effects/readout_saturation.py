"""A readout that serves one event after the other."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sim_backend.pixel.effects.base import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

__all__ = ["ReadoutSaturation"]


@dataclass(frozen=True, slots=True)
class ReadoutSaturation(Effect):
    """One server takes the events in order of time, ``1 / max_rate_eps`` each, and stamps them when it has done so.

    The last of n events at once is stamped ``n / max_rate_eps`` later. At most `fifo_events` wait, the one being
    served among them; an event that finds the queue full is lost. Events at the same time are taken row by row.

    Source: K. Boahen, "Point-to-point connectivity between neuromorphic chips using address events", IEEE
    Transactions on Circuits and Systems II 47 (2000).
    """

    id: ClassVar[str] = "readout_saturation"
    stage: ClassVar[Stage] = "readout"
    knows_light: ClassVar[bool] = False
    sign: ClassVar[str] = (
        "The response falls only where many pixels answer at once; latency spreads with the number of events."
    )

    max_rate_eps: float = parameter("1/s", (1.0, math.inf), 1e6, math.inf, "events that can be served per second")
    fifo_events: float = parameter("1", (1.0, math.inf), 4096.0, math.inf, "most events in the queue")

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:  # noqa: ARG002 - nothing differs between pixels
        """Return the chain with this readout."""
        if self.max_rate_eps == math.inf:
            return chain
        return replace(chain, queue_eps=self.max_rate_eps, queue_events=self.fifo_events)
