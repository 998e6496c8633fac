"""The fast engine: from event to event instead of from sample to sample."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from drivers.events.types import EVENT_DTYPE
from protocols.errors import InputError
from sim_backend.pixel.chain import LOWEST_CURRENT_FA, Chain, pixel_ids
from sim_backend.pixel.engines.readout import has_readout
from sim_backend.pixel.engines.reference import ReferenceEngine, processors
from sim_backend.pixel.light import first_sample_at
from sim_backend.pixel.light_path import commanded_light, moves
from sim_backend.pixel.philox import split_seed

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from sim_backend.pixel.light import LightHistory

    Events = npt.NDArray[np.void]

__all__ = ["FastEngine", "is_faster"]

_US_PER_S: Final = 1e6
#: A recording that ends this close to a sample, in samples, ends before it.
_TIE_SAMPLES: Final = 1e-6
#: Later than any sample.
_LAST: Final = 1 << 62
#: Pixels that one thread takes at a time, and room for their events until they are handed over.
_PIXELS: Final = 256
_ROOM: Final = 16384
#: Time constants after an edge or a reset until the table of rates holds: exp(-6) of what was is left.
_SETTLE_TAUS: Final = 6.0
#: Below this ratio of sample to time constant blocks alone are as fast as the table, and the table would be large.
_TABLE_RATE: Final = 2e-3
#: Longest block, in time constants and in samples.
_LONGEST_TAUS: Final = 2.0
_LONGEST_SAMPLES: Final = 20000
#: A block lasts no more than the square of the distance of both levels, in rms, over this:
#: no path goes from one to the other in it.
_BLOCKS_APART: Final = 40.0


def is_faster(chain: Chain, dt_s: float) -> npt.NDArray[np.bool_]:
    """Return for each pixel whether going from event to event is cheaper than going through all samples.

    Without noise, or while the light moves for long behind each edge, it is not. Nor is it for a pixel that has an
    event every few hundred samples: its two thresholds less than 8 rms apart, and few samples in a time constant.
    """
    if chain.noise_rms == 0.0 or chain.rise_tau_s > 0.0:
        return np.zeros(chain.pixels, np.bool_)
    rate = 2.0 * math.pi * chain.corner_hz * dt_s
    apart = (chain.theta_on + chain.theta_off) / chain.noise_rms
    return np.asarray((apart >= 8.0) | (apart**2 / 40.0 >= 40.0 * rate))


@dataclass(frozen=True, slots=True)
class FastEngine:
    """The distribution of events of ``ReferenceEngine(step="exact")`` on the same grid, at a fraction of the cost.

    Pixels for which the reference engine is cheaper (:func:`is_faster`) are given to it: without noise the events are
    identical to its own. The same seed gives the same events of a pixel, whatever the number of threads, the other
    pixels and the length of the stretches in which the events are handed over; other events than the reference
    engine's, since fewer random numbers are drawn.

    Parameters
    ----------
    dt_s
        Length of a sample, s.
    threads
        Number of threads; None for as many as there are processors for this process.
    stretch_samples
        Samples for which events are gathered before they are handed over; bounds the memory.
    """

    dt_s: float = 1e-5
    threads: int | None = None
    stretch_samples: int = 65536

    def __post_init__(self) -> None:
        if not 0.0 < self.dt_s < math.inf:
            raise InputError(f"fast engine: dt is {self.dt_s} s; expected more than 0")
        if self.threads is not None and self.threads < 1:
            raise InputError(f"fast engine: {self.threads} threads; expected 1 or more")
        if self.stretch_samples < 1:
            raise InputError(f"fast engine: stretches of {self.stretch_samples} samples; expected 1 or more")

    def events(self, chain: Chain, light: LightHistory, duration_s: float, seed: int) -> Iterator[Events]:
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
            Both light and chain have a rise time.
        """
        from sim_backend.pixel.engines.lanes import needs_general

        chain = _with_injection_in_thresholds(chain)
        on_chip = commanded_light(chain, light)
        fast = is_faster(replace(chain, rise_tau_s=on_chip.rise_tau_s), self.dt_s)
        reference = ReferenceEngine(dt_s=self.dt_s, threads=self.threads)
        if needs_general(chain) or has_readout(chain) or moves(chain) or not np.any(fast):
            return reference.events(chain, light, duration_s, seed)
        samples = math.ceil(duration_s / self.dt_s - _TIE_SAMPLES)
        quick = _Recording(self, _some_pixels(chain, fast), on_chip, seed).stretches(samples)
        if np.all(fast):
            return quick
        return _merged(quick, reference.events(_some_pixels(chain, ~fast), light, duration_s, seed))


def _with_injection_in_thresholds(chain: Chain) -> Chain:
    """Return a chain with the same events: an offset of the memorised level moves both thresholds against it."""
    offset = chain.injection_ln
    return replace(chain, theta_on=chain.theta_on + offset, theta_off=chain.theta_off - offset, injection_ln=0.0)


def _some_pixels(chain: Chain, which: npt.NDArray[np.bool_]) -> Chain:
    """Return the chain of some of its pixels."""
    arrays: dict[str, Any] = {}
    for f in fields(chain):
        value = getattr(chain, f.name)
        if isinstance(value, np.ndarray):
            arrays[f.name] = value[which]
    return replace(chain, **arrays)


def _in_order(events: Events) -> Events:
    return events[np.lexsort((events["x"], events["y"], events["t"]))]


def _merged(a: Iterator[Events], b: Iterator[Events]) -> Iterator[Events]:
    """Yield the events of two streams in order."""
    empty = np.empty(0, EVENT_DTYPE)
    waiting = [empty, empty]
    streams = [a, b]
    while True:
        for i in (0, 1):
            if len(waiting[i]) == 0:
                waiting[i] = next(streams[i], empty)
        if len(waiting[0]) == 0 or len(waiting[1]) == 0:
            break
        until = min(waiting[0]["t"][-1], waiting[1]["t"][-1])
        # A later array of the stream that ends here begins after this time: both engines hand over whole samples.
        cut = [int(np.searchsorted(w["t"], until, side="right")) for w in waiting]
        yield _in_order(np.concatenate([w[:c] for w, c in zip(waiting, cut, strict=True)]))
        waiting = [w[c:] for w, c in zip(waiting, cut, strict=True)]
    for left, stream in zip(waiting, streams, strict=True):
        if len(left):
            yield left
        yield from stream


def _blocks(rate: float) -> tuple[npt.NDArray[np.float64], ...]:
    """Return what a block of n samples needs, n from 0 to the longest: exp(-x), sqrt(1 - exp(-2 x)), cosh(x / 2)."""
    longest = min(max(1, int(_LONGEST_TAUS / rate)), _LONGEST_SAMPLES)
    x = rate * np.arange(longest + 1)
    return np.exp(-x), np.sqrt(-np.expm1(-2.0 * x)), np.cosh(0.5 * x)


class _Recording:
    """The pixels of one recording on their way through time."""

    def __init__(self, engine: FastEngine, chain: Chain, light: LightHistory, seed: int) -> None:
        from sim_backend.pixel.engines import fast_kernels

        self._kernels: Any = fast_kernels
        self._engine = engine
        self._chain = chain
        self._key = tuple(np.uint32(word) for word in split_seed(seed))
        self._rate = 2.0 * math.pi * chain.corner_hz * engine.dt_s
        self._first = np.append(first_sample_at(light.t_s, engine.dt_s), _LAST)
        self._lux = light.lux + chain.stray_lux
        self._blocks = _blocks(self._rate)
        apart = (chain.theta_on + chain.theta_off) / chain.noise_rms
        self._longest = np.clip(apart**2 / (_BLOCKS_APART * self._rate), 1, len(self._blocks[0]) - 1).astype(np.int64)
        self._settle, self._tables = self._hazard()
        self._pixel = pixel_ids(chain.x, chain.y)
        self._order = np.lexsort((chain.x, chain.y))
        self._rank = np.empty(chain.pixels, np.int64)
        self._rank[self._order] = np.arange(chain.pixels)
        self._fixed = np.stack(
            [
                chain.gain_fa_per_lux,
                chain.dark_fa,
                chain.theta_on / chain.noise_rms,
                chain.theta_off / chain.noise_rms,
            ],
            axis=1,
        )
        self._dead = np.rint(chain.refractory_s / engine.dt_s).astype(np.int64)
        self._start()

    def stretches(self, samples: int) -> Iterator[Events]:
        """Yield the events of each stretch of time that has any."""
        threads = self._engine.threads or processors()
        begins = range(0, self._chain.pixels, _PIXELS)
        early = np.empty(0, np.int64)
        with ThreadPoolExecutor(max(1, min(threads, len(begins)))) as pool:
            for first in range(1, samples, self._engine.stretch_samples):
                stop = min(first + self._engine.stretch_samples, samples)
                futures = [pool.submit(self._advance, begin, stop) for begin in begins]
                found = np.concatenate([early, *(future.result() for future in futures)])
                found.sort()
                due = int(np.searchsorted(found, stop * self._chain.pixels * 2))
                early = found[due:]
                if due:
                    yield self._as_events(found[:due])

    def _hazard(self) -> tuple[int, tuple[npt.NDArray[np.float64], ...]]:
        """Return after how many samples the table of rates holds, and the table."""
        if self._rate < _TABLE_RATE:
            return _LAST, (np.zeros((1, 2)), np.zeros((2, 2)), np.zeros((2, 2)))
        from sim_backend.pixel.engines.hazard import hazard_table

        table = hazard_table(math.exp(-self._rate))
        return math.ceil(_SETTLE_TAUS / self._rate), (table.log_rate[None, :], table.inside, table.beyond)

    def _start(self) -> None:
        """Put all pixels at t = 0: settled at the first level, memorised, armed."""
        k, n = self._kernels, self._chain.pixels
        self._whole = np.zeros((n, k.WHOLE), np.int64)
        self._real = np.zeros((n, k.REAL))
        self._store = np.zeros((n, k.DRAWS), np.float32)
        segment = int(np.searchsorted(self._first, 0, side="right")) - 1
        current = np.maximum(self._fixed[:, k.GAIN] * self._lux[segment] + self._fixed[:, k.DARK], LOWEST_CURRENT_FA)
        self._whole[:, k.SEGMENT] = segment
        self._whole[:, k.WAKE] = k.NEVER
        self._whole[:, k.QUIET] = self._settle
        self._whole[:, k.USED] = k.DRAWS
        self._real[:, k.LEVEL] = np.log(current) / self._chain.noise_rms
        self._real[:, k.OUTPUT] = self._kernels.start_normals(self._pixel, *self._key)
        self._real[:, k.REFERENCE] = self._real[:, k.OUTPUT]

    def _advance(self, begin: int, stop: int) -> npt.NDArray[np.int64]:
        """Take some pixels to sample `stop` - 1 or beyond, and return their events as the kernel codes them."""
        mine = slice(begin, begin + _PIXELS)
        sensor = tuple(a[mine] for a in (self._fixed, self._dead, self._pixel, self._rank, self._longest))
        state = (self._whole[mine], self._real[mine], self._store[mine])
        pixels = len(self._pixel[mine])
        room = np.empty(_ROOM, np.int64)
        parts = []
        i = 0
        while i < pixels:
            i, count = self._kernels.run_pixels(
                i,
                stop,
                (self._first, self._lux),
                self._rate,
                self._chain.noise_rms,
                self._settle,
                self._key,
                LOWEST_CURRENT_FA,
                self._chain.pixels,
                sensor,
                self._blocks,
                self._tables,
                state,
                room,
            )
            parts.append(room[:count].copy())
        return np.concatenate(parts)

    def _as_events(self, found: npt.NDArray[np.int64]) -> Events:
        sample, pixel = np.divmod(found >> 1, self._chain.pixels)
        events = np.empty(len(found), EVENT_DTYPE)
        events["t"] = np.rint(sample * (self._engine.dt_s * _US_PER_S))
        events["x"] = self._chain.x[self._order][pixel]
        events["y"] = self._chain.y[self._order][pixel]
        events["p"] = found & 1
        return events
