"""Pixels with two low-passes, noise that follows the light, or slow noise, on their way from event to event."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sim_backend.pixel.chain import LOWEST_CURRENT_FA, pixel_ids
from sim_backend.pixel.engines.segments import segments_of
from sim_backend.pixel.engines.stretches import places, room_for
from sim_backend.pixel.light_path import ChipLight
from sim_backend.pixel.philox import split_seed

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel.chain import Chain
    from sim_backend.pixel.light import LightHistory

    Floats = npt.NDArray[np.float64]

__all__ = ["TwoPoles", "slow_noise"]

#: Longest block, in time constants of the source follower.
_LONGEST_TAUS: Final = 16.0
#: Beside less noise than this, ln units, an edge is followed until it has settled to this.
_SMALL_NOISE: Final = 1e-3


class TwoPoles:
    """The pixels of one recording; see :class:`sim_backend.pixel.engines.stretches.Walk`."""

    stretch_samples = 262144

    def __init__(
        self, chain: Chain, light: LightHistory, dt_s: float, seed: int, slopes: Floats | None = None
    ) -> None:
        from sim_backend.pixel.engines import lanes, two_pole_kernels

        self._kernels: Any = two_pole_kernels
        self.chain = chain
        self.dt_s = dt_s
        self._key = tuple(np.uint32(word) for word in split_seed(seed))
        self._on_chip = ChipLight(chain, light, dt_s, seed)
        grid = lanes.Grid(dt_s, euler=False)
        self._c = lanes.coefficients(grid, chain)
        self._segments = segments_of(self._on_chip, max(chain.noise_rms, _SMALL_NOISE), dt_s)
        self._leaks = chain.leak_per_s_per_lux * self._segments.lux * dt_s
        if slopes is not None:
            self._leaks = self._leaks - slopes
        self._slow = slow_noise(chain, dt_s)
        self._lux: tuple[Floats, int] = (np.zeros(0), 0)
        self.order, rank = places(chain)
        self._pixel = pixel_ids(chain.x, chain.y)
        fixed = np.stack(
            [chain.gain_fa_per_lux, chain.dark_fa, chain.theta_on, chain.theta_off, chain.leak_per_s * dt_s], axis=1
        )
        dead = np.rint((chain.refractory_s + chain.comparator_delay_s) / dt_s).astype(np.int64)
        self._sensor = (fixed, dead, self._pixel, rank)
        self._start(grid, float(self._on_chip.lux(0, 1)[0]))

    def prepare(self, first: int, stop: int) -> None:
        """Get ready for a stretch of samples."""
        if self._segments.moving:
            self._lux = (self._on_chip.lux(first, stop), first)

    def advance(self, pixels: slice, stop: int) -> npt.NDArray[np.int64]:
        """Take some pixels to sample `stop` - 1, and return their events."""
        light = (self._segments.first, self._segments.until, self._segments.lux, self._leaks, *self._lux)
        sensor = tuple(a[pixels] for a in self._sensor)
        state = tuple(a[pixels] for a in self._state)
        work = self._kernels.work_room(len(self._slow) - 1)

        def run(i: int, room: npt.NDArray[np.int64]) -> tuple[int, int]:
            found: tuple[int, int] = self._kernels.run_pixels(
                i, stop, light, self._c, self._slow, self._key, self.chain.pixels, sensor, state, work, room
            )
            return found

        return room_for(len(sensor[0]), run)

    def _start(self, grid: Any, lux: float) -> None:
        """Put all pixels at t = 0: settled at the first light, memorised, armed."""
        from sim_backend.pixel.engines import general_kernels, lanes, reference_kernels

        k, n, fixed, chain = self._kernels, self.chain.pixels, self._sensor[0], self.chain
        whole, real, store = (
            np.zeros((n, k.WHOLE), np.int64),
            np.zeros((n, k.REAL)),
            np.zeros((n, k.DRAWS), np.float32),
        )
        segment = int(np.searchsorted(self._segments.first, 0, side="right")) - 1
        whole[:, k.SEGMENT] = segment
        whole[:, k.WAKE] = k.NEVER
        whole[:, k.USED] = k.DRAWS
        settled_lux = self._segments.lux[segment]
        level = np.log(np.maximum(fixed[:, k.GAIN] * settled_lux + fixed[:, k.DARK], LOWEST_CURRENT_FA))
        current = np.maximum(fixed[:, k.GAIN] * lux + fixed[:, k.DARK], LOWEST_CURRENT_FA)
        z = general_kernels.start_normals(self._pixel, *self._key)
        z = np.vstack([reference_kernels.start_normals(self._pixel, *self._key), z])
        v, p, slow, _ = lanes.settled(grid, self._c, current, z)
        real[:, k.LEVEL] = level
        real[:, k.V], real[:, k.P], real[:, k.SLOW] = v - level, p - level, slow
        reset = chain.reset_rms * general_kernels.reset_normals(0, self._pixel, *self._key)
        memorised = real[:, k.V] + slow + reset
        real[:, k.ON_LEVEL] = memorised + fixed[:, k.ON]
        real[:, k.OFF_LEVEL] = memorised - fixed[:, k.OFF]
        self._state = (whole, real, store)


def slow_noise(chain: Chain, dt_s: float) -> Floats:
    """Return the law of the slow noise over blocks of 2^j samples, and in their middle, as the kernels take it."""
    from sim_backend.pixel.engines import block_law_kernels as k

    tau_s = 1.0 / (2.0 * math.pi * chain.corner_hz)
    levels = int(np.clip(math.log2(_LONGEST_TAUS * tau_s / dt_s), 2, k.MOST_HALVINGS))
    x = dt_s / chain.slow_tau_s * 2.0 ** np.arange(levels + 1)
    slow = np.empty((levels + 1, k.SLOW_COLUMNS))
    slow[:, k.S_FADE] = np.exp(-x)
    slow[:, k.S_STEP] = chain.slow_rms * np.sqrt(-np.expm1(-2.0 * x))
    slow[:, k.S_MIDDLE] = 0.5 / np.cosh(0.5 * x)
    slow[:, k.S_REST] = chain.slow_rms * np.sqrt(np.tanh(0.5 * x))
    return slow
