"""What a waveform is to a source that times it by itself: one level, or a square wave after a pause."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from drivers.interfaces import Waveform

__all__ = ["SAME_TIME_S", "Constant", "NoShape", "SquareWave", "edges_of", "shape_of"]

#: Two times are the same if they are nearer than this, s: half of what an event camera can tell apart.
SAME_TIME_S: Final = 0.5e-6


@dataclass(frozen=True, slots=True)
class Constant:
    """One level."""

    level: float
    duration_s: float


@dataclass(frozen=True, slots=True)
class SquareWave:
    """A low level, and from `first_edge_s` on pulses of a higher one, all alike and evenly spaced.

    A single pulse has no period; it gets one in which it fits.
    """

    low: float
    high: float
    first_edge_s: float  #: the low level comes first, for so long
    period_s: float
    duty: float  #: high part of a period
    cycles: int
    ends_high: bool  #: the last pulse lasts until the end, and the level stays there
    duration_s: float

    @property
    def last_fall_s(self) -> float:
        """Time at which the last pulse ends."""
        return self.first_edge_s + (self.cycles - 1 + self.duty) * self.period_s


@dataclass(frozen=True, slots=True)
class NoShape:
    """None of those that were looked for, and why."""

    reason: str


def shape_of(waveform: Waveform) -> Constant | SquareWave | NoShape:
    """Return what `waveform` is, or why it is neither constant nor a square wave.

    Raises
    ------
    ValueError
        It is no waveform: its times do not ascend from 0, or it ends before its last edge.
    """
    t_s, level = edges_of(waveform)
    if len(level) == 1:
        return Constant(float(level[0]), waveform.duration_s)
    levels = np.unique(level)
    if len(levels) > 2:
        return NoShape(f"it has {len(levels)} levels; a square wave has two")
    if level[0] == levels[1]:
        return NoShape("it begins with the higher of its two levels; a square wave begins with the lower one")
    return _square_of(t_s, levels, waveform.duration_s)


def edges_of(waveform: Waveform) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return times and levels of `waveform` where the level changes, the beginning first.

    Raises
    ------
    ValueError
        It is no waveform: its times do not ascend from 0, or it ends before its last edge.
    """
    _require_times(waveform)
    edge = np.concatenate([[True], np.diff(waveform.level) != 0.0])
    return waveform.t_s[edge], waveform.level[edge]


def _require_times(waveform: Waveform) -> None:
    t_s = waveform.t_s
    if not len(t_s) or len(t_s) != len(waveform.level):
        raise ValueError(f"a waveform has as many times as levels, and at least one; got {len(t_s)}")
    if t_s[0] != 0.0 or not np.all(np.diff(t_s) >= 0.0):
        raise ValueError("the times of a waveform must ascend from 0 s")
    if not t_s[-1] <= waveform.duration_s < np.inf:
        raise ValueError(f"a waveform of {waveform.duration_s} s has an edge after its end")


def _square_of(
    t_s: npt.NDArray[np.float64], levels: npt.NDArray[np.float64], duration_s: float
) -> SquareWave | NoShape:
    rise, fall = t_s[1::2], t_s[2::2]
    ends_high = len(fall) < len(rise)
    fall = np.append(fall, duration_s) if ends_high else fall
    width_s, cycles = float(np.mean(fall - rise)), len(rise)
    if np.any(np.abs(fall - rise - width_s) > SAME_TIME_S) or width_s <= SAME_TIME_S:
        return NoShape("its pulses are not of one length")
    if cycles == 1:
        low_s = duration_s - float(fall[0])
        period_s = width_s + (low_s if SAME_TIME_S < low_s < width_s else width_s)
    else:
        period_s = float(rise[-1] - rise[0]) / (cycles - 1)
    if np.any(np.abs(rise - rise[0] - period_s * np.arange(cycles)) > SAME_TIME_S):
        return NoShape("its pulses are not evenly spaced")
    first_edge_s = float(rise[0])
    return SquareWave(
        float(levels[0]), float(levels[1]), first_edge_s, period_s, width_s / period_s, cycles, ends_high, duration_s
    )
