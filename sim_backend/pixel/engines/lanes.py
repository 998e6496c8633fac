"""Pixels that go through time side by side: the fast kernel for plain ones, the general one for all others."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sim_backend.pixel.chain import ELEMENTARY_CHARGE_FA_S, LOWEST_CURRENT_FA, pixel_ids
from sim_backend.pixel.engines import general_kernels, reference_kernels
from sim_backend.pixel.engines.stationary import draw, stationary_covariance

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel.chain import Chain

    Floats = npt.NDArray[np.float64]

__all__ = [
    "GeneralLanes",
    "Grid",
    "LightStretch",
    "PlainLanes",
    "coefficients",
    "in_parts",
    "settled",
    "to_lanes",
]

#: Room for as many events as there can be in this many blocks; then the kernel hands over.
_ROOM_BLOCKS: Final = 2


@dataclass(frozen=True, slots=True)
class Grid:
    """The samples in time, and how a low-pass is stepped on them."""

    dt_s: float
    euler: bool

    def forget(self, ratio: Floats | float) -> Floats:
        """Return the factor by which a low-pass forgets in a sample of `ratio` time constants."""
        ratio = np.asarray(ratio, np.float64)
        return np.where(np.isfinite(ratio) & self.euler, 1.0 - ratio, np.exp(-ratio))

    def ratio(self, corner_hz: Floats | float) -> Floats:
        """Return the length of a sample over the time constant of a corner."""
        return np.asarray(2.0 * math.pi * self.dt_s * np.asarray(corner_hz), np.float64)


@dataclass(frozen=True, slots=True)
class LightStretch:
    """The light at the samples of a stretch, up to the end of its last block."""

    first: int  #: number of the first sample
    stop: int  #: one above the number of the last sample
    lux: Floats  #: at each sample
    steady: npt.NDArray[np.bool_]  #: for each block, whether the light is one value
    leaked: Floats  #: at each sample, drift of D by the light since the start of the recording, ln units


class _Group:
    """What all groups have; lanes without a pixel never have an event."""

    def __init__(self, grid: Grid, chain: Chain, pixels: slice, key: tuple[Any, Any]) -> None:
        lanes = reference_kernels.LANES
        self.pixels = pixels
        self.key = key
        self.pixel = to_lanes(pixel_ids(chain.x[pixels], chain.y[pixels]), lanes, 0)
        self.gain = to_lanes(chain.gain_fa_per_lux[pixels], lanes, 1.0)
        self.dark = to_lanes(chain.dark_fa[pixels], lanes, 1.0)
        self.on = to_lanes(chain.theta_on[pixels] + chain.injection_ln, lanes, np.inf)
        self.off = to_lanes(chain.theta_off[pixels] - chain.injection_ln, lanes, np.inf)
        self.fixed = np.stack([self.gain, self.dark, self.on, self.off])
        dead_s = to_lanes(chain.refractory_s[pixels] + chain.comparator_delay_s, lanes, 0.0)
        self.dead = np.rint(dead_s / grid.dt_s).astype(np.int64)
        self.wake = np.full(lanes, reference_kernels.NEVER, np.int64)
        self.levels = np.empty(2 * lanes)

    def current_fa(self, lux: float) -> Floats:
        """Return the photocurrent of each lane."""
        return np.asarray(np.maximum(self.gain * lux + self.dark, LOWEST_CURRENT_FA))

    def memorise(self, value: Floats) -> None:
        """Set the comparators around `value`."""
        self.levels[:] = np.concatenate([value + self.on, value - self.off])


class PlainLanes(_Group):
    """One low-pass, one noise, constant thresholds."""

    def __init__(self, grid: Grid, chain: Chain, pixels: slice, start_lux: float, key: tuple[Any, Any]) -> None:
        super().__init__(grid, chain, pixels, key)
        self._rho, self._sigma = _source_follower(grid, chain)
        self._v = np.log(self.current_fa(start_lux))
        self._v += chain.noise_rms * reference_kernels.start_normals(self.pixel, *key)
        self.memorise(self._v)

    def advance(self, light: LightStretch) -> npt.NDArray[np.int64]:
        """Go through a stretch; return the events, (m, 3): sample, lane, polarity."""

        def run(n: int, skip: int, room: npt.NDArray[np.int64]) -> tuple[int, int]:
            found: tuple[int, int] = reference_kernels.run_group(
                n, light.stop, light.lux[skip:], light.steady[skip // reference_kernels.BLOCK :],
                self._rho, self._sigma, *self.key, LOWEST_CURRENT_FA,
                self.fixed, self.dead, self.pixel, self._v, self.levels, self.wake, room,
            )  # fmt: skip
            return found

        return in_parts(light, run)


class GeneralLanes(_Group):
    """Shot noise, photoreceptor, slow noise, high-pass, leaks, noise of resets."""

    def __init__(self, grid: Grid, chain: Chain, pixels: slice, start_lux: float, key: tuple[Any, Any]) -> None:
        super().__init__(grid, chain, pixels, key)
        self.c = coefficients(grid, chain)
        self.leak = to_lanes(chain.leak_per_s[pixels], reference_kernels.LANES, 0.0)
        z = np.vstack(
            [reference_kernels.start_normals(self.pixel, *key), general_kernels.start_normals(self.pixel, *key)]
        )
        current = self.current_fa(start_lux)
        self.kept = settled(grid, self.c, current, z, self.at_light(current)).ravel()
        v, _, slow, memory = self.kept.reshape(4, -1)
        reset = chain.reset_rms * general_kernels.reset_normals(0, self.pixel, *key)
        self.memorise(v + slow - memory + reset)

    def advance(self, light: LightStretch) -> npt.NDArray[np.int64]:
        """Go through a stretch; return the events, (m, 3): sample, lane, polarity."""

        def run(n: int, skip: int, room: npt.NDArray[np.int64]) -> tuple[int, int]:
            found: tuple[int, int] = general_kernels.run_group(
                n, light.stop, light.lux[skip:], light.steady[skip // reference_kernels.BLOCK :], light.leaked[skip:],
                self.c, *self.key, self.fixed, self.leak, self.dead, self.pixel, self.kept, self.levels, self.wake,
                room,
            )  # fmt: skip
            return found

        return in_parts(light, run)

    def at_light(self, current: Floats) -> tuple[Floats, Floats, Floats | float]:
        """Return for a photocurrent of each lane u, ratio of the photoreceptor, rms of the noise in a sample."""
        return at_light(self.c, current)


def coefficients(grid: Grid, chain: Chain) -> general_kernels.Coefficients:
    """Return what the general kernel has in common for all pixels of a chain."""
    rho, sigma = _source_follower(grid, chain)
    slow_rho = math.exp(-grid.dt_s / chain.slow_tau_s)
    return general_kernels.Coefficients(
        rho=rho,
        sigma=sigma,
        slow_rho=slow_rho,
        slow_sigma=chain.slow_rms * math.sqrt(1.0 - slow_rho**2),
        high_rho=math.exp(-2.0 * math.pi * chain.high_pass_hz * grid.dt_s),
        shot_fa=chain.shot_factor * ELEMENTARY_CHARGE_FA_S / grid.dt_s,
        receptor_per_fa=float(grid.ratio(chain.receptor_hz_per_fa)),
        receptor_most=float(grid.ratio(chain.receptor_max_hz)),
        euler=grid.euler,
        dt_s=grid.dt_s,
        lowest_fa=LOWEST_CURRENT_FA,
        reset_rms=float(chain.reset_rms),
    )


def at_light(c: general_kernels.Coefficients, current_fa: Floats) -> tuple[Floats, Floats, Floats | float]:
    """Return for a photocurrent, (n,), u, ratio of the photoreceptor, and rms of the noise in a sample."""
    return np.log(current_fa), np.minimum(c.receptor_per_fa * current_fa, c.receptor_most), c.sigma


def settled(
    grid: Grid,
    c: general_kernels.Coefficients,
    current_fa: Floats,
    z: Floats,
    given: tuple[Floats, Floats, Floats | float] | None = None,
) -> Floats:
    """Return source follower, photoreceptor, slow noise and high-pass at their joint stationary law, (4, n).

    Parameters
    ----------
    grid, c
        Samples and coefficients.
    current_fa
        (n,) photocurrent.
    z
        (4, n) standard normal numbers.
    given
        What the photocurrent gives, where it is not :func:`at_light`.
    """
    u, ratio, sigma = given or at_light(c, current_fa)
    covariance = stationary_covariance(*_transition(c, grid.forget(ratio), np.sqrt(c.shot_fa / current_fa), sigma))
    state = draw(covariance, z)
    state[0] += u
    state[1] += u
    if c.high_rho < 1.0:
        state[3] += u
    return state


def _source_follower(grid: Grid, chain: Chain) -> tuple[float, float]:
    """Return the factor of the low-pass, and the rms of what its noise adds in a sample."""
    ratio = 2.0 * math.pi * chain.corner_hz * grid.dt_s
    rho = 1.0 - ratio if grid.euler else math.exp(-ratio)
    return rho, chain.noise_rms * math.sqrt(1.0 - rho**2)


def _transition(
    c: general_kernels.Coefficients, forget: Floats, shot: Floats, sigma: Floats | float
) -> tuple[Floats, Floats]:
    """Return A (n, 4, 4) and B (n, 4, 3) of ``x <- A x + B z``, apart from the level.

    x is source follower, photoreceptor, slow noise and memory of the high-pass; z is shot noise, noise of the source
    follower, slow noise.
    """
    n = len(forget)
    a, b = np.zeros((n, 4, 4)), np.zeros((n, 4, 3))
    a[:, 1, 1] = forget
    b[:, 1, 0] = (1.0 - forget) * shot
    a[:, 0] = (1.0 - c.rho) * a[:, 1]
    a[:, 0, 0] += c.rho
    b[:, 0] = (1.0 - c.rho) * b[:, 1]
    b[:, 0, 1] = sigma
    a[:, 2, 2] = c.slow_rho
    b[:, 2, 2] = c.slow_sigma
    if c.high_rho < 1.0:
        a[:, 3] = (1.0 - c.high_rho) * (a[:, 0] + a[:, 2])
        a[:, 3, 3] += c.high_rho
        b[:, 3] = (1.0 - c.high_rho) * (b[:, 0] + b[:, 2])
    return a, b


def in_parts(light: LightStretch, run: Any) -> npt.NDArray[np.int64]:
    """Call `run` until it has reached the end of the stretch; return all events."""
    room = np.empty((_ROOM_BLOCKS * reference_kernels.BLOCK * reference_kernels.LANES, 3), np.int64)
    parts = []
    n = light.first
    while n < light.stop:
        n, count = run(n, n - light.first, room)
        parts.append(room[:count].copy())
    return np.concatenate(parts)


def to_lanes(values: npt.NDArray[Any], lanes: int, fill: float) -> npt.NDArray[Any]:
    """Return `values` with `fill` in the lanes that have no pixel."""
    full = np.full(lanes, fill, values.dtype)
    full[: len(values)] = values
    return full
