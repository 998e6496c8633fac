"""A waveform as samples: one cycle of it on a raster, for a source that plays its memory at a steady rate.

Edges must lie on the raster, to half a microsecond: what an event camera can tell apart is 1 us. What repeats from
the first edge on is stored once, so that a train of reset and test pulses needs the memory of one pair.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from drivers.light.waveform_shapes import SAME_TIME_S, NoShape, edges_of

if TYPE_CHECKING:
    import numpy.typing as npt

    from drivers.interfaces import Waveform

__all__ = ["Memory", "Samples", "codes_of", "samples_of"]

_FINEST_S: Final = 1e-6  #: an event camera tells no finer times
#: A raster is made finer up to so many samples, so that a step that is drawn as a slope of one sample is short.
_FINE: Final = 16_384
_STEP_ERROR: Final = 0.01  #: by how much of itself a step may differ from the one asked for
_AT_ONCE: Final = 4096  #: rasters that are tried together


@dataclass(frozen=True, slots=True)
class Memory:
    """What the memory for a waveform holds."""

    fewest: int  #: samples
    most: int  #: samples
    codes: int  #: different levels between the lowest and the highest
    highest_hz: float  #: samples in a second


@dataclass(frozen=True, slots=True)
class Samples:
    """One cycle of a waveform, which begins and ends at its first level, and how often it is played."""

    level: npt.NDArray[np.float64]  #: (samples,) in the unit of the source
    period_s: float  #: of the cycle
    cycles: int
    lead_s: float  #: from the begin of the cycle to its first edge
    t_s: npt.NDArray[np.float64]  #: (m,) when the edges come, as they are played; the first is 0
    duration_s: float  #: of the waveform

    @property
    def rate_hz(self) -> float:
        """Samples in a second."""
        return len(self.level) / self.period_s

    @property
    def lowest(self) -> float:
        """Lowest level."""
        return float(self.level.min())

    @property
    def highest(self) -> float:
        """Highest level."""
        return float(self.level.max())

    @property
    def rest(self) -> float:
        """Where the level between bursts lies: 0 is the lowest, 1 the highest one."""
        return (float(self.level[0]) - self.lowest) / (self.highest - self.lowest)


def samples_of(waveform: Waveform, memory: Memory) -> Samples | NoShape:
    """Return `waveform` as samples, or why it cannot be had.

    Raises
    ------
    ValueError
        It is no waveform: its times do not ascend from 0, or it ends before its last edge.
    """
    t_s, level = edges_of(waveform)
    edges, base = t_s[1:], float(level[0])
    if not len(edges):
        return NoShape("it has no edge")
    if level[-1] != base:
        return NoShape(
            f"it ends at {level[-1]:g} and begins at {base:g}; samples end at the level of their beginning"
        )
    block, cycles, period_s = _repetition(edges, level[1:])
    offsets = edges[:block] - edges[0]
    span_s = period_s if cycles > 1 else float(offsets[-1])
    raster = _raster(offsets, span_s, memory)
    if isinstance(raster, NoShape):
        return raster
    step_s = span_s / raster
    index = np.rint(offsets / step_s).astype(np.int64)
    idle = raster - int(index[-1]) if cycles > 1 else memory.fewest
    lead = max(1, min(idle // 2, int(edges[0] / step_s) // 2))
    if lead * step_s > edges[0]:
        return NoShape(
            f"its first edge comes {edges[0]:.3g} s after the beginning, within a sample of {step_s:.3g} s"
        )
    count = raster if cycles > 1 else max(lead + raster + 1, memory.fewest)
    steps = np.concatenate([[0], lead + index, [count]])
    levels = np.repeat(np.concatenate([[base], level[1 : block + 1]]), np.diff(steps))
    played = edges[0] + (np.arange(cycles)[:, None] * count + index[None, :]).ravel() * step_s
    return Samples(levels, count * step_s, cycles, lead * step_s, np.append(0.0, played), waveform.duration_s)


def codes_of(samples: Samples, memory: Memory) -> npt.NDArray[np.int64] | NoShape:
    """Return the samples as codes, 0 for the lowest level, or why they cannot be told so finely."""
    code_step = (samples.highest - samples.lowest) / (memory.codes - 1)
    code = np.rint((samples.level - samples.lowest) / code_step).astype(np.int64)
    asked, had = np.diff(samples.level), np.diff(code) * code_step
    worst = int(np.argmax(np.abs(had - asked) - _STEP_ERROR * np.abs(asked)))
    if abs(had[worst] - asked[worst]) > _STEP_ERROR * abs(asked[worst]):
        return NoShape(
            f"its step of {abs(asked[worst]):.4g} would be {abs(had[worst]):.4g}: between {samples.lowest:g} and "
            f"{samples.highest:g} there are {memory.codes} levels"
        )
    return code


def _repetition(edges: npt.NDArray[np.float64], level: npt.NDArray[np.float64]) -> tuple[int, int, float]:
    """Return the number of edges of the shortest part that all of it repeats, how often, and its period, s."""
    count = len(edges)
    for block in range(2, count // 2 + 1):
        if count % block:
            continue
        cycles = count // block
        if np.any(level.reshape(cycles, block) != level[:block]):
            continue
        period_s = float(edges[-1] - edges[block - 1]) / (cycles - 1)
        expected = np.arange(cycles)[:, None] * period_s + edges[None, :block]
        if np.all(np.abs(edges.reshape(cycles, block) - expected) <= SAME_TIME_S):
            return block, cycles, period_s
    return count, 1, 0.0


def _raster(offsets: npt.NDArray[np.float64], span_s: float, memory: Memory) -> int | NoShape:
    """Return in how many samples `span_s` is divided so that all `offsets` are on the raster."""
    shortest_s = float(min(np.diff(offsets).min(initial=np.inf), span_s - offsets[-1] or np.inf))
    finest_s = max(_FINEST_S, 1.0 / memory.highest_hz)
    if shortest_s < finest_s - 1e-12:
        return NoShape(f"two of its edges are {shortest_s:.3g} s apart; {finest_s:.3g} s is the shortest sample")
    most = min(memory.most - memory.fewest, math.floor(span_s / finest_s + 1e-6))
    parts = np.arange(1, max(math.floor(most * shortest_s / span_s + 1e-6), 1) + 1)
    for first in range(0, len(parts), _AT_ONCE):
        samples = np.rint(span_s / shortest_s * parts[first : first + _AT_ONCE])
        step_s = span_s / samples
        off = np.abs(offsets[None, :] - np.rint(offsets[None, :] / step_s[:, None]) * step_s[:, None])
        sound = np.flatnonzero((off <= SAME_TIME_S).all(axis=1) & (samples <= most))
        if len(sound):
            coarse = int(samples[sound[0]])
            finer = max(min(_FINE, most) // coarse, 1)
            return coarse * max(finer, -(-memory.fewest // coarse))
    return NoShape(
        f"its edges lie on no common raster to {1e6 * SAME_TIME_S:g} us that has {memory.most} samples or fewer in "
        f"{span_s:.4g} s"
    )
