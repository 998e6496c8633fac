"""The reference engine: every sample of every pixel."""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from drivers.events.types import EVENT_DTYPE
from protocols.errors import InputError
from sim_backend.pixel.chain import LOWEST_CURRENT_FA, Chain, pixel_ids
from sim_backend.pixel.light import LightHistory, LightSampler
from sim_backend.pixel.philox import split_seed

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

__all__ = ["ReferenceEngine"]

_US_PER_S: Final = 1e6
#: A recording that ends this close to a sample, in samples, ends before it.
_TIE_SAMPLES: Final = 1e-6
#: Room for as many events as there can be in this many blocks; then the kernel hands over.
_ROOM_BLOCKS: Final = 2


@dataclass(frozen=True, slots=True)
class ReferenceEngine:
    """Low-pass, noise, comparators and dead time, sample by sample.

    The output of the low-pass is ``V[n] = rho V[n-1] + (1 - rho) u[n] + rms sqrt(1 - rho^2) z[n]`` with standard
    normal z: white noise before the low-pass, scaled so that the stationary rms behind it is `rms`. At sample n the
    light is that of the time ``n dt``. A recording starts at t = 0 with V at its stationary law around the first
    level, memorised, and no dead time running; the first comparison is at sample 1. After an event at sample n the
    pixel is blind for ``round(refractory / dt)`` samples; the output at the last of them is memorised.

    The same seed gives the same events of a pixel, whatever the number of threads, the other pixels and the length of
    the stretches in which the events are handed over.

    Parameters
    ----------
    dt_s
        Length of a sample, s.
    step
        "exact": ``rho = exp(-dt / tau)``, the low-pass of continuous time. "euler": ``rho = 1 - dt / tau``, as in the
        published simulation (B. McReynolds et al., "Re-interpreting the step-response probability curve to extract
        fundamental physical parameters of event-based vision sensors", 2024).
    threads
        Number of threads; None for as many as there are processors for this process.
    stretch_samples
        Samples for which events are gathered before they are handed over; bounds the memory.
    """

    dt_s: float = 1e-5
    step: Literal["exact", "euler"] = "exact"
    threads: int | None = None
    stretch_samples: int = 8192

    def __post_init__(self) -> None:
        if not 0.0 < self.dt_s < math.inf:
            raise InputError(f"reference engine: dt is {self.dt_s} s; expected more than 0")
        if self.step not in ("exact", "euler"):
            raise InputError(f"reference engine: step is {self.step!r}; expected exact or euler")
        if self.threads is not None and self.threads < 1:
            raise InputError(f"reference engine: {self.threads} threads; expected 1 or more")
        if self.stretch_samples < 1:
            raise InputError(f"reference engine: stretches of {self.stretch_samples} samples; expected 1 or more")

    def events(
        self, chain: Chain, light: LightHistory, duration_s: float, seed: int
    ) -> Iterator[npt.NDArray[np.void]]:
        """Yield the events of a recording as arrays of `EVENT_DTYPE`, in order of time and of pixel within a time.

        Parameters
        ----------
        chain
            The pixels.
        light
            The light on the chip.
        duration_s
            Events before this time are given, s.
        seed
            Of this recording, 0 to 2^64 - 1.

        Raises
        ------
        InputError
            `dt_s` is too long for the corner (Euler form), or both light and chain have a rise time.
        """
        samples = math.ceil(duration_s / self.dt_s - _TIE_SAMPLES)
        sampler = LightSampler(light_on_chip(chain, light), self.dt_s)
        return _Recording(self, chain, sampler, seed).stretches(samples)

    def rho(self, corner_hz: float) -> float:
        """Return the factor by which the low-pass forgets in one sample."""
        ratio = 2.0 * math.pi * corner_hz * self.dt_s
        if self.step == "exact":
            return math.exp(-ratio)
        if ratio >= 1.0:
            raise InputError(
                f"reference engine: dt {self.dt_s:g} s is not below the time constant of {corner_hz:g} Hz "
                f"({self.dt_s / ratio:.3g} s); use a shorter dt or the exact step"
            )
        return 1.0 - ratio


def light_on_chip(chain: Chain, light: LightHistory) -> LightHistory:
    """Return the light with what the chain does to it."""
    if chain.rise_tau_s > 0.0 and light.rise_tau_s > 0.0:
        raise InputError(
            f"light: the source's rise time ({light.rise_tau_s:g} s) and the model's ({chain.rise_tau_s:g} s) are "
            "both given; expected one"
        )
    rise_tau_s = max(chain.rise_tau_s, light.rise_tau_s)
    return LightHistory(light.t_s, light.lux, rise_tau_s)


def processors() -> int:
    """Return the number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@dataclass(frozen=True, slots=True)
class _Group:
    """The pixels that go through time side by side; lanes without a pixel never have an event."""

    pixels: slice  #: which of the chain's
    fixed: npt.NDArray[np.float64]  #: (4, LANES) gain, dark current, ON and OFF threshold
    dead: npt.NDArray[np.int64]  #: (LANES,) samples of dead time
    pixel: npt.NDArray[np.uint32]  #: (LANES,) number on the sensor
    v: npt.NDArray[np.float64]  #: (LANES,) output of the low-pass
    levels: npt.NDArray[np.float64]  #: (2 LANES,) upper, then lower comparator levels
    wake: npt.NDArray[np.int64]  #: (LANES,) sample at which a blind lane is armed again


class _Recording:
    """The pixels of one recording on their way through time."""

    def __init__(self, engine: ReferenceEngine, chain: Chain, sampler: LightSampler, seed: int) -> None:
        from sim_backend.pixel.engines import reference_kernels

        self._kernels: Any = reference_kernels
        self._engine = engine
        self._chain = chain
        self._sampler = sampler
        self._rho = engine.rho(chain.corner_hz)
        self._sigma = chain.noise_rms * math.sqrt(1.0 - self._rho**2)
        self._key = tuple(np.uint32(word) for word in split_seed(seed))
        lanes = reference_kernels.LANES
        self._groups = [self._group(slice(i, min(i + lanes, chain.pixels))) for i in range(0, chain.pixels, lanes)]

    def stretches(self, samples: int) -> Iterator[npt.NDArray[np.void]]:
        """Yield the events of each stretch of time that has any."""
        block = self._kernels.BLOCK
        length = block * math.ceil(self._engine.stretch_samples / block)
        threads = self._engine.threads or processors()
        with ThreadPoolExecutor(max(1, min(threads, len(self._groups)))) as pool:
            for first in range(1, samples, length):
                stop = min(first + length, samples)
                lux, steady = self._light(first, stop)
                futures = [pool.submit(self._advance, group, first, stop, lux, steady) for group in self._groups]
                events = np.concatenate([future.result() for future in futures])
                if len(events):
                    yield events[np.lexsort((events["x"], events["y"], events["t"]))]

    def _light(self, first: int, stop: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
        """Return the light at each sample of whole blocks, and whether it is all one within each block."""
        block = self._kernels.BLOCK
        blocks = math.ceil((stop - first) / block)
        lux = self._sampler.lux(first, first + blocks * block) + self._chain.stray_lux
        by_block = lux.reshape(blocks, block)
        return lux, np.all(by_block == by_block[:, :1], axis=1)

    def _advance(
        self,
        group: _Group,
        first: int,
        stop: int,
        lux: npt.NDArray[np.float64],
        steady: npt.NDArray[np.bool_],
    ) -> npt.NDArray[np.void]:
        """Take one group through one stretch, and return its events."""
        room = np.empty((_ROOM_BLOCKS * self._kernels.BLOCK * self._kernels.LANES, 3), np.int64)
        parts = []
        n = first
        while n < stop:
            skip = n - first
            n, count = self._kernels.run_group(
                n,
                stop,
                lux[skip:],
                steady[skip // self._kernels.BLOCK :],
                self._rho,
                self._sigma,
                *self._key,
                LOWEST_CURRENT_FA,
                group.fixed,
                group.dead,
                group.pixel,
                group.v,
                group.levels,
                group.wake,
                room,
            )
            parts.append(self._as_events(group, room[:count]))
        return np.concatenate(parts)

    def _as_events(self, group: _Group, found: npt.NDArray[np.int64]) -> npt.NDArray[np.void]:
        events = np.empty(len(found), EVENT_DTYPE)
        events["t"] = np.rint(found[:, 0] * (self._engine.dt_s * _US_PER_S))
        events["x"] = self._chain.x[group.pixels][found[:, 1]]
        events["y"] = self._chain.y[group.pixels][found[:, 1]]
        events["p"] = found[:, 2]
        return events

    def _group(self, pixels: slice) -> _Group:
        """Return a group at t = 0: settled at the first level, memorised, armed."""
        chain, lanes = self._chain, self._kernels.LANES
        pixel = _to_lanes(pixel_ids(chain.x[pixels], chain.y[pixels]), lanes, 0)
        gain = _to_lanes(chain.gain_fa_per_lux[pixels], lanes, 1.0)
        dark = _to_lanes(chain.dark_fa[pixels], lanes, 1.0)
        on = _to_lanes(chain.theta_on[pixels], lanes, np.inf)
        off = _to_lanes(chain.theta_off[pixels], lanes, np.inf)
        dead_s = _to_lanes(chain.refractory_s[pixels], lanes, 0.0)
        lux = self._sampler.lux(0, 1)[0] + chain.stray_lux
        start = np.log(np.maximum(gain * lux + dark, LOWEST_CURRENT_FA))
        start += chain.noise_rms * self._kernels.start_normals(pixel, *self._key)
        return _Group(
            pixels=pixels,
            fixed=np.stack([gain, dark, on, off]),
            dead=np.rint(dead_s / self._engine.dt_s).astype(np.int64),
            pixel=pixel,
            v=start,
            levels=np.concatenate([start + on, start - off]),
            wake=np.full(lanes, self._kernels.NEVER, np.int64),
        )


def _to_lanes(values: npt.NDArray[Any], lanes: int, fill: float) -> npt.NDArray[Any]:
    """Return `values` with `fill` in the lanes that have no pixel."""
    full = np.full(lanes, fill, values.dtype)
    full[: len(values)] = values
    return full
