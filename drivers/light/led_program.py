"""From a waveform to the program that an LED driver stores: what repeats is stored once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from drivers.interfaces import Waveform

__all__ = ["LONGEST_US", "MOST_US", "CannotPlay", "Program", "program_of"]

LONGEST_US: Final = 2_000_000_000  #: between two edges, us: the device counts microseconds in 32 bits, with a sign
MOST_US: Final = (1 << 32) - 1  #: a whole waveform, us


class CannotPlay(Exception):
    """A waveform is none, or not one for this device; the text says why."""


@dataclass(frozen=True, slots=True)
class Program:
    """A begin level, stored edges of which a part is played several times, and a rest."""

    begin: int
    stored: list[tuple[int, int]]  #: us since the edge before, and the level from there on
    loop_from: int  #: first stored edge of the part that repeats
    loop_edges: int
    loops: int  #: so often is that part played; 1 if nothing repeats
    end_us: int  #: from the last edge to the end
    t_us: npt.NDArray[np.int64]  #: (m,) time of the begin and of each edge, as played
    duration_us: int

    @property
    def edges(self) -> int:
        """Number of edges that are played."""
        return len(self.t_us) - 1

    @property
    def square(self) -> tuple[int, int, int, int, int, int] | None:
        """Low, high, period, bright part, count and time before the first edge if it is a square wave, else None."""
        loop = self.stored[self.loop_from :][: self.loop_edges]
        if self.loop_edges != 2 or self.loops == 1 or len({level for _, level in loop}) != 2:
            return None
        if self.loop_from == 0:  # the time before the first edge is the dark part of a period
            (dark_us, high), (bright_us, low) = loop
            whole, count, preamble_us = list(loop), self.loops, dark_us
        else:
            (bright_us, low), (dark_us, high) = loop
            preamble_us, count = self.stored[0][0], self.loops + 1
            whole = [(preamble_us, high), *loop, (bright_us, low)]
        if self.stored != whole or self.begin != low or self.end_us != dark_us:
            return None
        return low, high, bright_us + dark_us, bright_us, count, preamble_us


def program_of(waveform: Waveform, *, tick_us: int, max_edges: int, shortest_us: int) -> Program:
    """Return `waveform` as a device of these limits plays it: times go to the nearest multiple of its tick.

    Raises
    ------
    CannotPlay
        It is no waveform, has edges too close or too far apart, or does not fit.
    """
    _require_waveform(waveform)
    per_tick = 1e6 / tick_us
    t_us = np.rint(waveform.t_s * per_tick).astype(np.int64) * tick_us
    duration_us = max(int(np.rint(waveform.duration_s * per_tick)) * tick_us, int(t_us[-1]))
    delta_us = np.diff(t_us)
    level = np.rint(waveform.level).astype(np.int64)
    _require_times(t_us, delta_us, duration_us, shortest_us)
    loop_from, loop_edges, loops = _longest_repetition(delta_us, level[1:], max_edges)
    pairs = list(zip(delta_us.tolist(), level[1:].tolist(), strict=True))
    stored = pairs[: loop_from + loop_edges] + pairs[loop_from + loop_edges * loops :]
    if len(stored) > max_edges:
        raise CannotPlay(
            f"its {len(pairs)} edges do not repeat exactly in steps of {tick_us} us, {len(stored)} would have to be "
            f"stored, and there is room for {max_edges}; choose times that are multiples of {tick_us} us"
        )
    end_us = duration_us - int(t_us[-1])
    return Program(int(level[0]), stored, loop_from, loop_edges, loops, end_us, t_us, duration_us)


def _require_waveform(waveform: Waveform) -> None:
    t_s = waveform.t_s
    if not len(t_s) or len(t_s) != len(waveform.level):
        raise CannotPlay(
            f"it has {len(t_s)} times and {len(waveform.level)} levels; expected as many, and one or more"
        )
    if t_s[0] != 0.0 or not np.all(np.diff(t_s) >= 0.0):
        raise CannotPlay("its times do not ascend from 0 s")
    if not t_s[-1] <= waveform.duration_s < np.inf:
        raise CannotPlay(f"it ends at {waveform.duration_s} s, and has its last edge at {t_s[-1]} s")


def _require_times(
    t_us: npt.NDArray[np.int64], delta_us: npt.NDArray[np.int64], duration_us: int, shortest_us: int
) -> None:
    """Raise unless all edges are so far apart that the device can time them."""
    if len(delta_us) and delta_us.min() < shortest_us:
        edge = int(delta_us.argmin())
        raise CannotPlay(
            f"two edges are {delta_us[edge]} us apart at {t_us[edge] / 1e6:g} s; {shortest_us} us is the least"
        )
    if duration_us > MOST_US:
        raise CannotPlay(f"it lasts {duration_us / 1e6:g} s; {MOST_US / 1e6:g} s is the most")
    longest_us = max(int(delta_us.max(initial=0)), duration_us - int(t_us[-1]))
    if longest_us > LONGEST_US:
        raise CannotPlay(f"{longest_us / 1e6:g} s pass without an edge; {LONGEST_US / 1e6:g} s is the most")


def _longest_repetition(
    delta_us: npt.NDArray[np.int64], level: npt.NDArray[np.int64], longest: int
) -> tuple[int, int, int]:
    """Return first edge, length and number of the repetitions of a block that leave the fewest edges to store.

    For each length of a block, edges that equal the edge one block later stand in runs; the longest run is the best
    place for that length. No block longer than what is already reached can leave less.
    """
    count = len(level)
    best, fewest = (0, count, 1), count
    for length in range(1, min(count // 2, longest) + 1):
        if length >= fewest:
            break
        same = (delta_us[length:] == delta_us[:-length]) & (level[length:] == level[:-length])
        first, run = _longest_run(same)
        loops = run // length + 1
        stored = count - length * (loops - 1)
        if stored < fewest:
            best, fewest = (first, length, loops), stored
    return best


def _longest_run(true: npt.NDArray[np.bool_]) -> tuple[int, int]:
    """Return begin and length of the longest stretch of True; the first of equals."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], true, [False]]).astype(np.int8)))
    begin, end = change[::2], change[1::2]
    if not len(begin):
        return 0, 0
    longest = int((end - begin).argmax())
    return int(begin[longest]), int(end[longest] - begin[longest])
