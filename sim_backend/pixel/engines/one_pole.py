"""Pixels with one low-pass, on their way from event to event."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sim_backend.pixel.chain import ELEMENTARY_CHARGE_FA_S, LOWEST_CURRENT_FA, pixel_ids
from sim_backend.pixel.engines.hazard import B_FIRST, B_STEP, hazard_table
from sim_backend.pixel.engines.moving_light import MovingLight
from sim_backend.pixel.engines.segments import LAST, segments_of
from sim_backend.pixel.engines.stairs import no_stairs, stairs_of
from sim_backend.pixel.engines.stretches import UNIT, places, room_for
from sim_backend.pixel.light_path import ChipLight
from sim_backend.pixel.philox import split_seed

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel.chain import Chain
    from sim_backend.pixel.engines.hazard import HazardTable
    from sim_backend.pixel.light import LightHistory

    Floats = npt.NDArray[np.float64]

__all__ = ["OnePole", "block_factors"]

#: Time constants after an edge or a reset until the table of rates holds: exp(-6) of what was is left.
_SETTLE_TAUS: Final = 6.0
#: Below this ratio of sample to time constant blocks alone are as fast as the table, and the table would be large.
_TABLE_RATE: Final = 2e-3
#: Longest block, in time constants (three make up a little more than the time until the table holds) and in samples.
_LONGEST_TAUS: Final = 2.1
_LONGEST_SAMPLES: Final = 20000
#: A block lasts no more than the square of the distance of both levels, in rms, over this:
#: no path goes from one to the other in it.
_BLOCKS_APART: Final = 40.0
#: Events are gathered for so many samples at the most, and so many times the number of pixels.
_STRETCH_SAMPLES: Final = 262144
_PIXEL_SAMPLES: Final = 1 << 27


class OnePole:
    """The pixels of one recording; see :class:`sim_backend.pixel.engines.stretches.Walk`.

    Shot noise is white to one low-pass: between two edges it makes the floor higher, if the light does not move.

    Of a high-pass, what it remembers of the light is taken off; it remembers no noise. `in_stairs` is light that goes
    in many small steps, as of :func:`sim_backend.pixel.engines.stepped_light.with_stairs`.
    """

    def __init__(
        self,
        chain: Chain,
        light: LightHistory,
        dt_s: float,
        seed: int,
        slopes: Floats | None = None,
        *,
        in_stairs: bool = False,
    ) -> None:
        from sim_backend.pixel.engines import fast_kernels

        self._kernels: Any = fast_kernels
        self.chain = chain
        self.dt_s = dt_s
        self._key = tuple(np.uint32(word) for word in split_seed(seed))
        self._rate = 2.0 * math.pi * chain.corner_hz * dt_s
        self._noise = (chain.noise_rms, _shot_variance_fa(chain, dt_s))
        on_chip = ChipLight(chain, light, dt_s, seed)
        start_lux = float(on_chip.lux(0, 1)[0])
        self._segments = segments_of(on_chip, chain.noise_rms, dt_s, restless=chain.high_pass_hz > 0.0)
        leaks = chain.leak_per_s_per_lux * self._segments.lux * (dt_s / chain.noise_rms)
        if slopes is not None:
            leaks = leaks - slopes / chain.noise_rms
        self._light = (self._segments.first, self._segments.until, self._segments.lux, leaks)
        self._factors = block_factors(self._rate)
        self._settle, self._tables = self._hazard()
        high_share = -math.expm1(-2.0 * math.pi * chain.high_pass_hz * dt_s)
        self._moving = MovingLight(chain, on_chip, self._segments, math.exp(-self._rate), high_share)
        self._stairs = no_stairs()
        if in_stairs and not self._segments.moving and np.ptp(leaks) == chain.shot_factor == 0.0:
            self._stairs = stairs_of(
                self._segments, start_lux, self._moving.dark_lux, self._moving.lowest_lux, self._rate, chain.noise_rms
            )
        self.stretch_samples = self._stretch_samples()
        self._pixel = pixel_ids(chain.x, chain.y)
        self.order, self._place = places(chain)
        self._sensor = self._fixed()
        self._start(start_lux)

    def prepare(self, first: int, stop: int) -> None:
        """Get ready for a stretch of samples."""
        self._moving.prepare(first - 1, stop)

    def advance(self, pixels: slice, stop: int) -> npt.NDArray[np.int64]:
        """Take some pixels to sample `stop` - 1 or beyond, and return their events."""
        sensor = (self.chain.pixels, *(a[pixels] for a in self._sensor))
        state = (*(a[pixels] for a in self._state), np.empty(self._kernels.DRAWS, np.uint32))

        def run(i: int, room: npt.NDArray[np.int64]) -> tuple[int, int]:
            found: tuple[int, int] = self._kernels.run_pixels(
                i, stop, self._light, self._rate, self._noise, self._settle, self._key, LOWEST_CURRENT_FA,
                self.chain.reset_rms / self.chain.noise_rms, sensor, self._factors, self._tables, self._moving.table,
                self._stairs, state, room,
            )  # fmt: skip
            return found

        return room_for(len(state[0]), run)

    def _stretch_samples(self) -> int:
        """Return the samples of a stretch: many for few pixels, since each stretch has a cost of its own."""
        most = min(_STRETCH_SAMPLES, _PIXEL_SAMPLES // self.chain.pixels, self._moving.stretch_samples)
        return max(most // UNIT, 1) * UNIT

    def _fixed(self) -> tuple[npt.NDArray[Any], ...]:
        """Return what is fixed for each pixel, as the kernel takes it."""
        k, chain = self._kernels, self.chain
        fixed = np.empty((chain.pixels, k.FIXED))
        fixed[:, k.GAIN] = chain.gain_fa_per_lux
        fixed[:, k.DARK] = chain.dark_fa
        fixed[:, k.ON] = chain.theta_on / chain.noise_rms
        fixed[:, k.OFF] = chain.theta_off / chain.noise_rms
        fixed[:, k.LEAK] = chain.leak_per_s * (self.dt_s / chain.noise_rms)
        fixed[:, k.NODE] = self._moving.place
        dead = np.rint((chain.refractory_s + chain.comparator_delay_s) / self.dt_s).astype(np.int64)
        apart = (chain.theta_on + chain.theta_off) / _largest_rms(chain, self._segments.lux, self.dt_s)
        longest = np.clip(apart**2 / (_BLOCKS_APART * self._rate), 1, len(self._factors) - 1).astype(np.int64)
        return fixed, dead, self._pixel, self._place, longest

    def _hazard(self) -> tuple[int, tuple[Floats, ...]]:
        """Return after how many samples the table of rates holds, and the table."""
        if self._rate < _TABLE_RATE:
            return LAST, (np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((2, 2)))
        return math.ceil(_SETTLE_TAUS / self._rate), _tables(math.exp(-self._rate))

    def _start(self, lux: float) -> None:
        """Put all pixels at t = 0: settled at the first light, memorised, armed."""
        from sim_backend.pixel.engines import general_kernels

        k, n, fixed = self._kernels, self.chain.pixels, self._sensor[0]
        whole, real, store = (
            np.zeros((n, k.WHOLE), np.int64),
            np.zeros((n, k.REAL)),
            np.zeros((n, k.DRAWS), np.float32),
        )
        segment = int(np.searchsorted(self._segments.first, 0, side="right")) - 1
        whole[:, k.SEGMENT] = segment
        whole[:, k.WAKE] = k.NEVER
        whole[:, k.CALM] = self._settle
        whole[:, k.QUIET] = min(self._settle + max(int(self._segments.until[segment]), 0), LAST)
        whole[:, k.USED] = k.DRAWS
        current, now_fa = (
            np.maximum(fixed[:, k.GAIN] * at_lux + fixed[:, k.DARK], LOWEST_CURRENT_FA)
            for at_lux in (self._segments.lux[segment], lux)
        )
        rms = _rms_at(self.chain, current, self.dt_s)
        of_floor = self.chain.noise_rms / rms
        level, now = np.log(current) / rms, np.log(now_fa) / rms
        z = k.start_normals(self._pixel, *self._key)
        z_reset = general_kernels.start_normals(self._pixel, *self._key)[0]
        real[:, k.LEVEL] = level
        real[:, k.OUTPUT] = now - level + z
        memorised = real[:, k.OUTPUT] + self.chain.reset_rms / self.chain.noise_rms * of_floor * z_reset
        real[:, k.ON_LEVEL] = memorised + fixed[:, k.ON] * of_floor
        real[:, k.OFF_LEVEL] = memorised - fixed[:, k.OFF] * of_floor
        self._state = (whole, real, store)


def _shot_variance_fa(chain: Chain, dt_s: float) -> float:
    """Return the variance that shot noise has behind the source follower, times the photocurrent, fA.

    White noise of variance s in each sample leaves ``s (1 - rho) / (1 + rho)`` of itself behind
    ``v <- rho v + (1 - rho) u``; s is ``shot_factor q / (I dt)``.
    """
    rho = math.exp(-2.0 * math.pi * chain.corner_hz * dt_s)
    return chain.shot_factor * ELEMENTARY_CHARGE_FA_S / dt_s * (1.0 - rho) / (1.0 + rho)


def _rms_at(chain: Chain, current_fa: Floats, dt_s: float) -> Floats:
    """(n,) rms of floor and shot noise together at a photocurrent."""
    shot = _shot_variance_fa(chain, dt_s)
    return np.asarray(np.sqrt(chain.noise_rms**2 + shot / current_fa) if shot > 0.0 else chain.noise_rms)


def _largest_rms(chain: Chain, lux: Floats, dt_s: float) -> Floats:
    """(n,) rms of each pixel at the dimmest of some lights."""
    current = np.maximum(chain.gain_fa_per_lux * float(np.min(lux)) + chain.dark_fa, LOWEST_CURRENT_FA)
    return _rms_at(chain, current, dt_s)


@lru_cache(maxsize=8)
def _tables(rho: float) -> tuple[Floats, Floats, Floats]:
    """Return the tables for noise that keeps the fraction `rho` of itself in one sample, as the kernels take them."""
    table = hazard_table(rho)
    return _rates(table), table.inside, table.beyond


def _rates(table: HazardTable) -> Floats:
    from sim_backend.pixel.engines import jump_kernels as k

    rates = np.full((len(table.log_rate), k.RATES), np.inf)
    b = B_FIRST + B_STEP * np.arange(len(rates))
    rates[:, k.LOG_RATE] = table.log_rate
    rates[:-1, k.MOST] = np.exp(np.maximum(table.log_rate[:-1], table.log_rate[1:]) - 0.5 * b[:-1] ** 2)
    return rates


@lru_cache(maxsize=8)
def block_factors(rate: float) -> Floats:
    """Return what a block of n samples needs, n from 0 to the longest, as the kernels take it."""
    from sim_backend.pixel.engines import block_kernels as k

    longest = min(max(1, int(_LONGEST_TAUS / rate)), _LONGEST_SAMPLES)
    x = rate * np.arange(longest + 1)
    factors = np.empty((longest + 1, k.FACTORS))
    factors[:, k.FADE] = np.exp(-x)
    factors[:, k.SPREAD] = np.sqrt(-np.expm1(-2.0 * x))
    factors[:, k.TANGENT] = np.cosh(0.5 * x)
    factors[1:, k.STEEPNESS] = 1.0 / np.sinh(x[1:])
    factors[0, k.STEEPNESS] = np.inf
    return factors
