"""Recordings of noisy pixels under constant light, as counts of each pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from protocols.errors import InputError
from protocols.points import Roi
from sim_backend.pixel import FastEngine, LightHistory, ReferenceEngine, build_chain

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel import Chain, PixelModel
    from sim_backend.pixel.engines import Engine

__all__ = ["Bench", "Step"]

Step = Literal["exact", "euler"]
_US_PER_S: Final = 1e6


@dataclass(frozen=True, slots=True)
class Bench:
    """Pixels under constant light, and how they are sampled."""

    model: PixelModel
    lux: float
    dt_s: float
    step: Step
    pixels: int
    seed: int

    def __post_init__(self) -> None:
        if not 0.0 < self.dt_s < math.inf:
            raise InputError(f"calibrate-noise: dt is {self.dt_s:g} s; expected more than 0")
        if not 0.0 <= self.lux < math.inf:
            raise InputError(f"calibrate-noise: the light is {self.lux:g} lux; expected 0 or more")
        if not 2 <= self.pixels <= 1 << 20:
            raise InputError(f"calibrate-noise: {self.pixels} pixels; expected 2 to {1 << 20}")
        self.rho()

    @property
    def roi(self) -> Roi:
        """The window: as square as the number of pixels allows."""
        width = next(w for w in range(math.isqrt(self.pixels), 0, -1) if self.pixels % w == 0)
        return Roi(0, 0, self.pixels // width, width)

    @property
    def dead_samples(self) -> int:
        """Samples for which a pixel is blind after an event."""
        return round(self.model.refractory_s / self.dt_s)

    def rho(self) -> float:
        """Return what the source follower keeps of its output in a sample."""
        return ReferenceEngine(dt_s=self.dt_s, step=self.step).rho(self.model.corner_hz)

    def counts(self, rms: float, wait_s: float, seconds: float, recording: int) -> npt.NDArray[np.int64]:
        """Return (pixels,) the events of each pixel in `seconds`, after `wait_s` from the reset.

        Parameters
        ----------
        rms
            Noise behind the source follower, ln units.
        recording
            Recordings of the same number share their random numbers.
        """
        roi = self.roi
        chain = build_chain(replace(self.model, noise_rms=rms), roi, sensor_seed=self.seed)
        engine, chain = self._engine(chain)
        total = np.zeros(roi.pixels, np.int64)
        light = LightHistory.constant(self.lux)
        for events in engine.events(chain, light, wait_s + seconds, (self.seed + recording) % (1 << 64)):
            late = events[events["t"] >= wait_s * _US_PER_S]
            total += np.bincount(late["y"].astype(np.int64) * roi.width + late["x"], minlength=roi.pixels)
        return total

    def _engine(self, chain: Chain) -> tuple[Engine, Chain]:
        """Return the engine, and the chain for it.

        The Euler step of one low-pass under constant light is the exact step of another corner, with ``exp(-2 pi f'
        dt) = 1 - 2 pi f dt``. A photoreceptor has an Euler step of its own.
        """
        if self.step == "exact":
            return FastEngine(dt_s=self.dt_s), chain
        if math.isfinite(min(chain.receptor_hz_per_fa, chain.receptor_max_hz)):
            return ReferenceEngine(dt_s=self.dt_s, step="euler"), chain
        corner_hz = -math.log(self.rho()) / (2.0 * math.pi * self.dt_s)
        return FastEngine(dt_s=self.dt_s), replace(chain, corner_hz=corner_hz)
