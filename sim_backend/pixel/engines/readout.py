"""What happens to events after the comparators, as a stream of bounded memory.

In this order: the comparators' delay, hot pixels, crosstalk, queue, jitter, sorting, trail filter, rate limit, the
functions of effects; then times are rounded to the microsecond. Each stage takes events in order of time together
with a time `until_us` that nothing later is before, and returns the same: it holds back what it cannot decide yet.

Random numbers are addressed by the recording's seed and the event's pixel, time and polarity: the same events have
the same fate, however they are cut into stretches. Source of the generator: see :mod:`sim_backend.pixel.philox`.
"""

from __future__ import annotations

import math
import zlib
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from drivers.events.types import EVENT_DTYPE
from sim_backend.pixel.chain import pixel_ids
from sim_backend.pixel.hooks import called, refused
from sim_backend.pixel.philox import philox4x32, split_seed

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

    from sim_backend.pixel.chain import Chain
    from sim_backend.pixel.hooks import Hook

    Floats = npt.NDArray[np.float64]
    Events = npt.NDArray[np.void]
    Batch = tuple[Events, float]
    #: What the comparators find: events of :data:`TIMED_DTYPE`, and the time that nothing later is before, us.
    Crossings = Iterator[Batch]

__all__ = ["TIMED_DTYPE", "EventDraws", "Readout", "has_readout", "read_out", "together"]

#: An event on its way: time in us, not yet rounded, column, row, polarity.
TIMED_DTYPE: Final = np.dtype([("t_us", "<f8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])

_US_PER_S: Final = 1e6
_NS_PER_US: Final = 1e3
_COPY_WITHIN_US: Final = 10.0
_MOST_SIGMA: Final = 9.0  # no number of _normals is larger
_TIE: Final = 1e-9  # a rate limit this much below a whole number of events is that number

# Third words of the counter; the kernels have lower ones.
_PURPOSE_HOT: Final = 32
_PURPOSE_CROSSTALK: Final = 33
_PURPOSE_JITTER: Final = 34
_PURPOSE_LIMIT: Final = 35
_PURPOSE_HOOK: Final = 1 << 31  # and above


class _Stage(Protocol):
    def take(self, events: Events, until_us: float) -> Batch:
        """Return the events that are decided, in order of time, and the time that nothing later is before."""


def has_readout(chain: Chain) -> bool:
    """Return whether anything happens to an event after the comparators."""
    return chain.comparator_delay_s > 0.0 or len(_stages(chain, 0, 0.0)) > 0


def read_out(chain: Chain, seed: int, duration_s: float, crossings: Crossings) -> Iterator[Events]:
    """Yield what a recording has of the comparators' events: `EVENT_DTYPE`, in order of time and of pixel."""
    if has_readout(chain):
        readout = Readout(chain, seed, duration_s)
        stamped = (readout.take(events, until_us) for events, until_us in crossings)
    else:
        stamped = (_stamp(events) for events, _ in crossings)
    return (events for events in stamped if len(events))


def together(streams: Sequence[Crossings]) -> Crossings:
    """Yield the events of several groups of pixels as one stream, in order of time."""
    held = _Held()
    until_us = [-math.inf] * len(streams)
    while min(until_us) < math.inf:
        behind = int(np.argmin(until_us))
        events, until_us[behind] = next(streams[behind])
        yield held.release(events, min(until_us)), min(until_us)


class Readout:
    """The readout of one recording.

    Parameters
    ----------
    chain
        The pixels.
    seed
        Of the recording.
    duration_s
        Events that are stamped before 0 or at this time or later are not in the recording.
    """

    def __init__(self, chain: Chain, seed: int, duration_s: float) -> None:
        self._delay_us = chain.comparator_delay_s * _US_PER_S
        self._duration_us = duration_s * _US_PER_S
        self._stages = _stages(chain, seed, self._duration_us)
        self._rounded = _Held()

    def take(self, events: Events, until_us: float) -> Events:
        """Return what can be said of the recording once these events have happened.

        Parameters
        ----------
        events
            New events of the comparators, of :data:`TIMED_DTYPE`, in any order.
        until_us
            No later event is before this time; infinity after the last.

        Returns
        -------
        Events of `EVENT_DTYPE`, in order of time, row and column; none is before one that was returned earlier.
        """
        events = _sorted(events).copy()
        events["t_us"] += self._delay_us
        for stage in self._stages:
            events, until_us = stage.take(events, until_us)
        t_us = events["t_us"]
        events = events[(t_us >= 0.0) & (t_us < self._duration_us)]
        events["t_us"] = np.rint(events["t_us"])
        return _stamp(self._rounded.release(events, np.rint(until_us)))


def _stamp(events: Events) -> Events:
    """Return events as `EVENT_DTYPE`, in order of time, row and column."""
    from sim_backend.pixel.engines.readout_kernels import is_in_order

    stamped = np.empty(len(events), EVENT_DTYPE)
    stamped["t"] = np.rint(events["t_us"])
    for name in ("x", "y", "p"):
        stamped[name] = events[name]
    # Those of most engines are already.
    if is_in_order(stamped["t"], stamped):
        return stamped
    return stamped[np.lexsort([stamped[name] for name in ("p", "x", "y", "t")])]


def _stages(chain: Chain, seed: int, duration_us: float) -> list[_Stage]:
    """Return the stages that do anything, in the order in which an event passes them."""
    stages: list[_Stage] = []
    if np.any(chain.hot_hz > 0.0):
        stages.append(_HotPixels(chain, seed, duration_us))
    if chain.crosstalk > 0.0:
        stages.append(_Crosstalk(chain, seed))
    if chain.queue_eps < math.inf:
        stages.append(_Queue(chain))
    if chain.jitter_s > 0.0:
        stages.append(_Jitter(chain, seed))
    if chain.trail_s > 0.0:
        stages.append(_TrailFilter(chain))
    if chain.limit_eps < math.inf:
        stages.append(_RateLimit(chain, seed))
    stages.extend(_Hooked(chain, hook, seed) for hook in chain.hooks.events)
    return stages


class _HotPixels:
    """Poisson events of hot pixels: exponential times between them, numbered in each pixel."""

    def __init__(self, chain: Chain, seed: int, duration_us: float) -> None:
        hot = chain.hot_hz > 0.0
        self._x, self._y = chain.x[hot], chain.y[hot]
        self._pixel = pixel_ids(self._x, self._y)
        self._mean_us = _US_PER_S / chain.hot_hz[hot]
        self._key = split_seed(seed)
        self._duration_us = duration_us
        self._number = np.zeros(len(self._pixel), np.int64)
        self._next_us = self._interval(np.arange(len(self._pixel)))

    def take(self, events: Events, until_us: float) -> Batch:
        """Return the events with those of the hot pixels."""
        own = []
        before_us = min(until_us, self._duration_us)
        while len(due := np.flatnonzero(self._next_us < before_us)):
            found = np.ones(len(due), TIMED_DTYPE)
            found["t_us"], found["x"], found["y"] = self._next_us[due], self._x[due], self._y[due]
            own.append(found)
            self._number[due] += 1
            self._next_us[due] += self._interval(due)
        return _sorted(np.concatenate([events, *own])), until_us

    def _interval(self, which: npt.NDArray[np.int64]) -> Floats:
        words = _words(self._key, self._number[which], self._pixel[which], _PURPOSE_HOT)
        return np.asarray(-np.log(_positive(words[:, 0])) * self._mean_us[which])


class _Crosstalk:
    """Copies of events in one of the four direct neighbours."""

    def __init__(self, chain: Chain, seed: int) -> None:
        self._probability = chain.crosstalk
        self._window = np.sort(pixel_ids(chain.x, chain.y))
        self._key = split_seed(seed)
        self._held = _Held()

    def take(self, events: Events, until_us: float) -> Batch:
        """Return the events with their copies."""
        words = _event_words(self._key, events, _PURPOSE_CROSSTALK)
        copied = _unit(words[:, 0]) < self._probability
        copies, words = events[copied], words[copied]
        step = (words[:, 1] >> np.uint32(30)).astype(np.int64)
        x = copies["x"] + np.array([1, -1, 0, 0])[step]
        y = copies["y"] + np.array([0, 0, 1, -1])[step]
        copies["t_us"] += _COPY_WITHIN_US * _unit(words[:, 2])
        copies["x"], copies["y"] = x & 0xFFFF, y & 0xFFFF
        inside = (x >= 0) & (y >= 0) & np.isin(pixel_ids(copies["x"], copies["y"]), self._window)
        return self._held.release(np.concatenate([events, copies[inside]]), until_us), until_us


class _Queue:
    """One server with a queue."""

    def __init__(self, chain: Chain) -> None:
        self._service_us = _US_PER_S / chain.queue_eps
        self._most = float(chain.queue_events)
        self._last_us = -math.inf

    def take(self, events: Events, until_us: float) -> Batch:
        """Return the events that were served, at the times when they had been."""
        from sim_backend.pixel.engines.readout_kernels import serve

        t_us = events["t_us"].copy()
        served = np.empty(len(events), np.bool_)
        self._last_us = serve(t_us, self._service_us, self._most, self._last_us, served)
        events = events.copy()
        events["t_us"] = t_us
        return events[served], max(until_us, self._last_us)


class _Jitter:
    """Gaussian errors of the time stamps, and sorting."""

    def __init__(self, chain: Chain, seed: int) -> None:
        self._sigma_us = chain.jitter_s * _US_PER_S
        self._key = split_seed(seed)
        self._held = _Held()

    def take(self, events: Events, until_us: float) -> Batch:
        """Return the events with their errors, sorted again."""
        events = events.copy()
        events["t_us"] += self._sigma_us * _normals(_event_words(self._key, events, _PURPOSE_JITTER))
        until_us -= _MOST_SIGMA * self._sigma_us
        return self._held.release(events, until_us), until_us


class _TrailFilter:
    """The first event of each run of one polarity in a pixel."""

    def __init__(self, chain: Chain) -> None:
        pixel = pixel_ids(chain.x, chain.y)
        self._window_us = chain.trail_s * _US_PER_S
        self._pixel = np.sort(pixel)
        self._last_us = np.full(len(pixel), -math.inf)
        self._last_polarity = np.full(len(pixel), -1, np.int8)

    def take(self, events: Events, until_us: float) -> Batch:
        """Return the events that begin a run."""
        from sim_backend.pixel.engines.readout_kernels import first_of_runs

        first = np.empty(len(events), np.bool_)
        index = np.searchsorted(self._pixel, pixel_ids(events["x"], events["y"]))
        t_us, polarity = events["t_us"].copy(), events["p"].copy()
        first_of_runs(t_us, index, polarity, self._window_us, self._last_us, self._last_polarity, first)
        return events[first], until_us


class _RateLimit:
    """At most so many events in each period; which ones is random."""

    def __init__(self, chain: Chain, seed: int) -> None:
        self._period_us = chain.limit_period_s * _US_PER_S
        self._in_period = chain.limit_eps * chain.limit_period_s
        self._key = split_seed(seed)
        self._waiting = np.empty(0, TIMED_DTYPE)

    def take(self, events: Events, until_us: float) -> Batch:
        """Return the events of the periods that are over."""
        events = np.concatenate([self._waiting, events])
        period = np.floor(events["t_us"] / self._period_us)
        current = np.floor(until_us / self._period_us)
        over = period < current
        self._waiting = events[~over]
        passed = self._passes(events[over], period[over])
        return events[over][passed], min(until_us, current * self._period_us)

    def _passes(self, events: Events, period: Floats) -> npt.NDArray[np.bool_]:
        draw = _event_words(self._key, events, _PURPOSE_LIMIT)[:, 0]
        order = np.lexsort((draw, period))
        ordered = period[order]
        rank = np.arange(len(events)) - np.searchsorted(ordered, ordered)
        allowed = np.floor((ordered + 1.0) * self._in_period + _TIE) - np.floor(ordered * self._in_period + _TIE)
        passes = np.empty(len(events), np.bool_)
        passes[order] = rank < allowed
        return passes


class EventDraws:
    """Random numbers of events, by pixel, time and polarity: the same event has the same number for a purpose.

    Parameters
    ----------
    seed
        Of the recording.
    """

    def __init__(self, seed: int) -> None:
        self._key = split_seed(seed)

    def uniform(self, events: Events, purpose: str) -> Floats:
        """Return a number from 0 to below 1 for each event; name the purpose ``"<id>.<what>"``."""
        return _unit(self._words(events, purpose)[:, 0])

    def normal(self, events: Events, purpose: str) -> Floats:
        """Return a standard normal number for each event; name the purpose ``"<id>.<what>"``."""
        return _normals(self._words(events, purpose))

    def _words(self, events: Events, purpose: str) -> npt.NDArray[np.uint32]:
        return _event_words(self._key, events, _PURPOSE_HOOK | zlib.crc32(purpose.encode()))


class _Hooked:
    """A function of an effect."""

    def __init__(self, chain: Chain, hook: Hook, seed: int) -> None:
        self._window = np.unique(pixel_ids(chain.x, chain.y))
        self._hook = hook
        self._draws = EventDraws(seed)
        self._memory: dict[str, Any] = {}
        self._held = _Held()

    def take(self, events: Events, until_us: float) -> Batch:
        """Return what the function makes of the events; an added one outside the window is lost."""
        if len(events) == 0:
            return self._held.release(events, until_us), until_us
        made = called(self._hook, events.copy(), self._draws, self._memory)
        if not isinstance(made, np.ndarray) or made.dtype != TIMED_DTYPE or made.ndim != 1:
            found = f"an array of {made.dtype}" if isinstance(made, np.ndarray) else f"a {type(made).__name__}"
            raise refused(self._hook, found, f"an array of events, {TIMED_DTYPE}")
        early = ~(made["t_us"] >= events["t_us"][0])
        if np.any(early):
            at = f"an event at {made['t_us'][early][0]:g} us"
            raise refused(self._hook, at, f"none before {events['t_us'][0]:g} us, the first that it was given")
        if np.any(made["p"] > 1):
            raise refused(self._hook, f"an event of polarity {made['p'].max()}", "1 for ON or 0 for OFF")
        inside = np.isin(pixel_ids(made["x"], made["y"]), self._window)
        return self._held.release(made[inside], until_us), until_us


class _Held:
    """Events that wait until nothing can come before them any more."""

    def __init__(self) -> None:
        self._waiting = np.empty(0, TIMED_DTYPE)

    def release(self, events: Events, until_us: float) -> Events:
        """Return what is before `until_us` of these and of those that waited, in order."""
        together = _sorted(np.concatenate([self._waiting, events]))
        end = int(np.searchsorted(together["t_us"], until_us, side="left"))
        self._waiting = together[end:].copy()
        return together[:end].copy()


def _sorted(events: Events) -> Events:
    """Return the events in order of time, row, column and polarity; the same ones where they are already."""
    from sim_backend.pixel.engines.readout_kernels import is_in_order

    if is_in_order(events["t_us"], events):
        return events
    return events[np.lexsort((events["p"], events["x"], events["y"], events["t_us"]))]


def _event_words(key: tuple[int, int], events: Events, purpose: int) -> npt.NDArray[np.uint32]:
    """Return the (n, 4) random words of events, by pixel, time in ns and polarity."""
    address = np.rint(events["t_us"] * _NS_PER_US).astype(np.int64) * 2 + events["p"]
    return _words(key, address, pixel_ids(events["x"], events["y"]), purpose)


def _words(
    key: tuple[int, int], address: npt.NDArray[np.int64], pixel: npt.NDArray[np.uint32], purpose: int
) -> npt.NDArray[np.uint32]:
    counter = np.empty((len(address), 4), np.uint32)
    counter[:, 0] = address & 0xFFFFFFFF
    counter[:, 1] = pixel
    counter[:, 2] = purpose
    counter[:, 3] = (address >> 32) & 0xFFFFFFFF
    return philox4x32(counter, key)


def _unit(words: npt.NDArray[np.uint32]) -> Floats:
    """Return numbers from 0 to below 1."""
    return np.asarray(words.astype(np.float64) * 2.0**-32)


def _positive(words: npt.NDArray[np.uint32]) -> Floats:
    """Return numbers between 0 and 1, both excluded."""
    return np.asarray((words.astype(np.float64) + 0.5) * 2.0**-32)


def _normals(words: npt.NDArray[np.uint32]) -> Floats:
    """Return a standard normal number of each row of words: Box-Muller, to 6.8 sigma."""
    radius = np.sqrt(-2.0 * np.log(_positive(words[:, 0])))
    return np.asarray(radius * np.cos(2.0 * math.pi * _unit(words[:, 1])))
