"""Which pixels go through time side by side, and by which kernel."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from sim_backend.pixel.engines import reference_kernels
from sim_backend.pixel.engines.lanes import GeneralLanes, PlainLanes

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from sim_backend.pixel.chain import Chain
    from sim_backend.pixel.engines.lanes import Grid, LightStretch

__all__ = ["Lanes", "groups", "needs_general"]


class Lanes(Protocol):
    """The pixels that go through time side by side."""

    pixels: slice  #: which of the chain's

    def advance(self, light: LightStretch) -> npt.NDArray[np.int64]:
        """Go through a stretch; return the events, (m, 3): sample, lane, polarity."""


def groups(grid: Grid, chain: Chain, start_lux: float, key: tuple[Any, Any], general: bool) -> list[Lanes]:
    """Return the chain's pixels in groups, at t = 0: settled at the first light, memorised, armed.

    Parameters
    ----------
    grid
        Samples.
    chain
        The pixels.
    start_lux
        Light on the chip at t = 0.
    key
        Seed of the recording, two uint32.
    general
        Take the general kernel even if the plain one would do.
    """
    kind = _kind(chain, general)
    lanes = reference_kernels.LANES
    return [
        kind(grid, chain, slice(i, min(i + lanes, chain.pixels)), start_lux, key)
        for i in range(0, chain.pixels, lanes)
    ]


def _kind(chain: Chain, general: bool) -> Callable[[Grid, Chain, slice, float, tuple[Any, Any]], Lanes]:
    if chain.hooks.compiled:
        from sim_backend.pixel.engines.hooked_lanes import HookedLanes

        return HookedLanes
    return GeneralLanes if general or needs_general(chain) else PlainLanes


def needs_general(chain: Chain) -> bool:
    """Return whether a pixel has more than one low-pass, light-independent noise and constant thresholds."""
    return (
        chain.hooks.compiled
        or chain.shot_factor > 0.0
        or math.isfinite(min(chain.receptor_hz_per_fa, chain.receptor_max_hz))
        or chain.slow_rms > 0.0
        or chain.high_pass_hz > 0.0
        or chain.leak_per_s_per_lux != 0.0
        or chain.reset_rms > 0.0
        or bool(np.any(chain.leak_per_s != 0.0))
    )
