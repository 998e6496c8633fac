"""The reference engine: every sample of every pixel."""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from protocols.errors import InputError
from sim_backend.pixel.engines.readout import TIMED_DTYPE, read_out
from sim_backend.pixel.light_path import ChipLight
from sim_backend.pixel.philox import split_seed

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from sim_backend.pixel.chain import Chain
    from sim_backend.pixel.engines.lanes import LightStretch
    from sim_backend.pixel.engines.readout import Crossings
    from sim_backend.pixel.light import LightHistory

__all__ = ["ReferenceEngine"]

_US_PER_S: Final = 1e6
_SHARE: Final = "EVS_BENCH_THREADS"
#: A recording that ends this close to a sample, in samples, ends before it.
_TIE_SAMPLES: Final = 1e-6


@dataclass(frozen=True, slots=True)
class ReferenceEngine:
    """The whole chain, sample by sample.

    The output of the source follower is ``V[n] = rho V[n-1] + (1 - rho) p[n] + rms sqrt(1 - rho^2) z[n]`` with
    standard normal z: white noise before the low-pass, scaled so that the stationary rms behind it is `rms`. The
    photoreceptor is ``p[n] = a p[n-1] + (1 - a) (u[n] + shot noise)`` with a of the photocurrent at sample n; without
    one a is 0. High-pass and slow noise have the factor of continuous time in both forms of the step. At sample n the
    light is that of the time ``n dt``. A recording starts at t = 0 with all of these at their joint stationary law
    around the light of that moment, memorised, and no dead time running; the first comparison is at sample 1. After
    an event at sample n the pixel is blind for ``round((delay + refractory) / dt)`` samples; the output at the last
    of them is memorised. What an event does after the comparators: :mod:`sim_backend.pixel.engines.readout`.

    The same seed gives the same events of a pixel, whatever the number of threads, the other pixels (unless they
    share a readout) and the length of the stretches in which the events are handed over.

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
    general
        Take the general kernel even where the fast one would do; for comparisons.
    """

    dt_s: float = 1e-5
    step: Literal["exact", "euler"] = "exact"
    threads: int | None = None
    stretch_samples: int = 8192
    general: bool = False

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
            `dt_s` is too long for a corner (Euler form), or both light and chain have a rise time.
        """
        return read_out(chain, seed, duration_s, self.crossings(chain, light, duration_s, seed))

    def crossings(self, chain: Chain, light: LightHistory, duration_s: float, seed: int) -> Crossings:
        """Yield what the comparators find, in stretches of time; parameters are those of :meth:`events`."""
        samples = samples_before(duration_s, self.dt_s)
        self.rho(chain.corner_hz)
        self._check_receptor(chain)
        return _Recording(self, chain, ChipLight(chain, light, self.dt_s, seed), seed).crossings(samples)

    def _check_receptor(self, chain: Chain) -> None:
        """Raise :class:`InputError` if the photoreceptor can get too fast for the Euler form."""
        if self.step == "euler" and math.isfinite(min(chain.receptor_hz_per_fa, chain.receptor_max_hz)):
            self.rho(chain.receptor_max_hz)

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


def samples_before(duration_s: float, dt_s: float) -> int:
    """Return how many samples are before the end of a recording, with that at t = 0."""
    return math.ceil(duration_s / dt_s - _TIE_SAMPLES)


def processors() -> int:
    """Return the number of processors that this process may use.

    Where several processes share a machine, the environment variable ``EVS_BENCH_THREADS`` says how many each takes.
    """
    share = os.environ.get(_SHARE)
    if share is not None:
        if not share.isdecimal() or int(share) < 1:
            raise InputError(f"{_SHARE} is {share!r}; expected a number of threads, 1 or more")
        return int(share)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _Recording:
    """The pixels of one recording on their way through time."""

    def __init__(self, engine: ReferenceEngine, chain: Chain, light: ChipLight, seed: int) -> None:
        from sim_backend.pixel.engines import lane_groups, lanes, reference_kernels

        self._block: int = reference_kernels.BLOCK
        self._stretch = lanes.LightStretch
        self._engine = engine
        self._sample_us = engine.dt_s * _US_PER_S
        self._chain = chain
        self._light = light
        key = tuple(np.uint32(word) for word in split_seed(seed))
        grid = lanes.Grid(engine.dt_s, engine.step == "euler")
        self._groups = lane_groups.groups(grid, chain, light.lux(0, 1)[0], (key[0], key[1]), engine.general)

    def crossings(self, samples: int) -> Crossings:
        """Yield what the comparators find in each stretch, and the time that nothing later is before, us."""
        length = self._block * math.ceil(self._engine.stretch_samples / self._block)
        threads = self._engine.threads or processors()
        leaked_ln = 0.0
        with ThreadPoolExecutor(max(1, min(threads, len(self._groups)))) as pool:
            for first in range(1, samples, length):
                light = self._light_of(first, min(first + length, samples), leaked_ln)
                leaked_ln = float(light.leaked[light.stop - first - 1])
                futures = [pool.submit(group.advance, light) for group in self._groups]
                found = [future.result() for future in futures]
                events = [self._as_events(group.pixels, f) for group, f in zip(self._groups, found, strict=True)]
                yield np.concatenate(events), light.stop * self._sample_us
        yield np.empty(0, TIMED_DTYPE), math.inf

    def _as_events(self, pixels: slice, found: npt.NDArray[np.int64]) -> npt.NDArray[np.void]:
        events = np.empty(len(found), TIMED_DTYPE)
        events["t_us"] = found[:, 0] * self._sample_us
        events["x"] = self._chain.x[pixels][found[:, 1]]
        events["y"] = self._chain.y[pixels][found[:, 1]]
        events["p"] = found[:, 2]
        return events

    def _light_of(self, first: int, stop: int, leaked_ln: float) -> LightStretch:
        """Return the light at each sample of whole blocks."""
        blocks = math.ceil((stop - first) / self._block)
        lux = self._light.lux(first, first + blocks * self._block)
        by_block = lux.reshape(blocks, self._block)
        steps = self._chain.leak_per_s_per_lux * self._engine.dt_s * lux
        return self._stretch(
            first=first,
            stop=stop,
            lux=lux,
            steady=np.all(by_block == by_block[:, :1], axis=1),
            leaked=np.cumsum(np.concatenate([[leaked_ln], steps]))[1:],
        )
