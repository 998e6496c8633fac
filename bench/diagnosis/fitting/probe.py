"""An effect that was tried beside a fitted model, and what it does there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from bench.diagnosis.expected.parameters import Free
    from sim_backend.pixel.effects.base import Effect

    Floats = npt.NDArray[np.float64]

__all__ = ["Probe"]


@dataclass(frozen=True)
class Probe:
    """An effect at some size, and what it does to all statistics."""

    effect: type[Effect]
    free: tuple[Free, ...]  #: the numbers that switch it on, each probed by itself
    at: tuple[float, ...]  #: coordinate of each
    change: Floats  #: (2, n, k) whitened change of the statistics for each, from two sensors
    falls_by: float = 0.0  #: fall of the loss that was seen with the effect in this size, and nothing else changed
