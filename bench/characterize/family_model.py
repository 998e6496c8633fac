"""What a family of S-curves is expected to be: one noisy pixel at every light level, beside dark light.

At each level the step that arrives at the comparators is smaller than the step of the light (:mod:`.weber`), and the
rest is the noisy pixel of :mod:`bench.analysis.noisy_pixel`: one threshold and one mismatch for all levels, one
low-pass. The noise may grow as the light falls, ``rms^2 = floor^2 + shot / (E + E_d)``: so does the shot noise of a
photocurrent behind a first-order low-pass, ``q / (2 I tau)`` in units of ln^2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.first_passage import SurvivalTable, survival_table
from bench.analysis.noisy_pixel_model import Conditions, Pixels, gauss_nodes, probability, unanswered_over_time
from bench.characterize.rearming import Lags, left_of_reset
from bench.characterize.slow_step import slow_step

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.analysis.noisy_pixel_model import Survival
    from bench.characterize.levels import Level

    Floats = npt.NDArray[np.float64]

__all__ = ["Expected", "Family", "expected", "signals"]

_NODES: Final = 7  # thresholds over which an array is averaged
_LEAST_THETA: Final = 0.1  # threshold of a pixel, as a part of the mean
_EVERY: Final = 4  # of the times of the survival table serve for latencies
#: A photoreceptor with time constants below this, in units of that of the low-pass, only delays; above that it does
#: not.
_DELAYS_ONLY: Final = (0.15, 0.5)
_NOTHING: Final = 1e-12
_EVEN: Final = 1e-6
_LATEST, _LATE_TIMES = 100.0, 12  # how much longer than that table; late, chances fall off evenly
_LEAST_NOISE: Final = 1.0 / 20.0  # of the threshold: steeper curves are all alike
_LEAST_PART: Final = 0.05  # of the noise floor's variance, that stays however the shot noise is extrapolated


@dataclass(frozen=True, slots=True)
class Family:
    """The numbers of a sensor that its family of curves tells. The order is that of the fit."""

    theta: float  #: mean threshold of the array, ln
    noise_rms: float  #: floor: the noise far above the dark light, ln
    mismatch2: float  #: variance of the threshold over the pixels, ln^2; below 0 by chance
    ln_tau: float  #: of the low-pass, tau in s
    delay_s: float  #: of the light and the readout
    dark_lux: float  #: equivalent dark illuminance, mean over the pixels
    dark_spread2: float  #: variance over the pixels of its logarithm; below 0 by chance
    shot_lux: float  #: variance of the noise that goes with 1 / light, ln^2 lux; below 0 by chance
    slow_s_lux: float  #: time constant of the photoreceptor times the light, dark light included; below 0 by chance
    filter_od: float  #: by which filters are denser than they are said to be


@dataclass(frozen=True, slots=True)
class Expected:
    """What one level is expected to show."""

    share: Floats  #: (m,) of the pulses that find a pixel armed
    spread: Floats  #: (m,) variance of each pixel's chance over the pixels
    frozen: float  #: covariance, over pixels, of the sums of every second contrast and of the others
    latency_s: Floats  #: (k,) mean of the answers in the window


def signals(level: Level, family: Family) -> tuple[Floats, float]:
    """Return (m,) the change of the signal at each contrast, ln, and the light at the baseline with dark light."""
    lux = level.key.baseline_lux * 10.0 ** (-family.filter_od if level.key.nd_od > 0.0 else 0.0)
    total = lux + _typical_dark(family)
    if level.key.polarity == "on":
        return np.log1p(np.expm1(level.contrast) * lux / total), total
    return -np.log1p(np.expm1(-level.contrast) * lux / total), total


def _typical_dark(family: Family) -> float:
    """Return the dark illuminance of the pixel in the middle: that of a log-normal law lies below the mean."""
    return family.dark_lux * math.exp(-0.5 * family.dark_spread2)


def expected(level: Level, family: Family, other_ratio: float) -> Expected:
    """Return what a level is expected to show.

    A photoreceptor that is much faster than the low-pass only delays; one that is not is worked out, and between the
    two what is expected changes over smoothly.

    Parameters
    ----------
    other_ratio
        Threshold of the other polarity, divided by that of this one.
    """
    at = _Place(level, family, other_ratio)
    low, high = _DELAYS_ONLY
    slow = min(max((at.lag.max() - low) / (high - low), 0.0), 1.0)
    slow = slow * slow * (3.0 - 2.0 * slow)
    later_s = float(at.lag.mean()) * at.tau_s
    if slow == 0.0:
        return at.expected(_coarse_table(), later_s)
    behind = at.expected(slow_step(tuple(at.step.tolist()), tuple(at.lag.tolist()), level.window_s / at.tau_s), 0.0)
    return behind if slow == 1.0 else _between(at.expected(_coarse_table(), later_s), behind, slow)


def _between(a: Expected, b: Expected, part: float) -> Expected:
    share, spread, latency_s = (
        (1.0 - part) * getattr(a, name) + part * getattr(b, name) for name in ("share", "spread", "latency_s")
    )
    return Expected(share, spread, (1.0 - part) * a.frozen + part * b.frozen, latency_s)


class _Place:
    """A sensor at one light level."""

    def __init__(self, level: Level, family: Family, other_ratio: float) -> None:
        self._level, self._family = level, family
        self._signal, total = signals(level, family)
        self._noise, there, more2 = _noise(level, family, self._signal, total)
        self._stretch = self._noise / there
        # A pixel with more dark light sees less of a step, as if its threshold were higher by what the signal lacks.
        sign = 1.0 if level.key.polarity == "on" else -1.0
        part = _typical_dark(family) / total * np.abs(np.expm1(-sign * self._signal))
        self._frozen2 = family.mismatch2 + part**2 * family.dark_spread2
        self._spread2 = self._frozen2 + more2
        self.tau_s = math.exp(family.ln_tau)
        self.step = self._signal / there
        self.lag = _lag_s(level, family, self._signal, total) / self.tau_s
        opposite = other_ratio * family.theta
        self._theta = family.theta + _left_of_reset(level, family, self._noise, opposite, total)
        self._other_ratio = opposite / self._theta

    def expected(self, table: Survival, later_s: float) -> Expected:
        """Return what is expected from chances of no answer, all answers later by some time."""
        level, family = self._level, self._family
        size2 = np.maximum(np.abs(self._spread2), _NOTHING)
        sd = np.sqrt(size2)
        conditions = Conditions(self.tau_s, level.window_s - later_s, level.reset.armed_s, level.grid_s)
        mismatch = math.sqrt(max(float(self._spread2.mean()), 0.0))
        pixels = Pixels(self._theta, self._noise, mismatch, 1.0, self._other_ratio)
        z, weight = gauss_nodes(_NODES)
        theta = np.maximum(self._theta + z[:, None] * sd, _LEAST_THETA * family.theta)
        chance = probability(theta * self._stretch, pixels, conditions, self._signal * self._stretch, table)
        middle = chance[_NODES // 2]
        # Below none, by chance, or for OFF: the other way.
        way = np.sign(self._spread2)
        share = middle + way * (weight @ chance - middle)
        # Of that spread only the mismatch, of thresholds and of dark light, stays with a pixel.
        centred = (chance - weight @ chance) * np.sqrt(np.abs(self._frozen2) / size2)
        sign = np.sign(self._frozen2)
        even, odd = (centred * sign)[:, ::2].sum(axis=1), centred[:, 1::2].sum(axis=1)
        frozen = float(weight @ (even * odd))
        spread = np.where(sign > 0.0, weight @ centred**2, 0.0)
        latency_s = _latencies(pixels, conditions, self._signal[level.timed], self._stretch[level.timed], table)
        return Expected(share, spread, frozen, latency_s + later_s + family.delay_s)


def _noise(level: Level, family: Family, signal: Floats, total_lux: float) -> tuple[float, Floats, Floats]:
    """Return the rms of the noise at the baseline, (m,) after each step, and by how much its variance fell.

    Shot noise falls as the light rises, dark light included: after the step, or once the threshold is reached, by
    this factor. The reference was memorised at the baseline; its noise is that of the baseline.
    """
    sign = 1.0 if level.key.polarity == "on" else -1.0
    reached = np.exp(sign * np.minimum(signal, family.theta))
    floor2, shot2 = family.noise_rms**2, family.shot_lux / total_lux
    least2 = max(_LEAST_PART * floor2, (_LEAST_NOISE * family.theta) ** 2)
    return (
        math.sqrt(max(floor2 + shot2, least2)),
        np.sqrt(np.maximum(floor2 + shot2 / reached, least2)),
        np.asarray(shot2 - shot2 / reached),
    )


def _lag_s(level: Level, family: Family, signal: Floats, total_lux: float) -> Floats:
    """Return (m,) the time constant of the photoreceptor in the test pulse, s: it follows all the light."""
    sign = 1.0 if level.key.polarity == "on" else -1.0
    return np.asarray(family.slow_s_lux / total_lux * np.exp(-sign * signal))


def _left_of_reset(level: Level, family: Family, noise: float, opposite: float, total_lux: float) -> float:
    """Return by how much the reference lies beyond the baseline: what a slow photoreceptor still saw of the reset."""
    lag_s = family.slow_s_lux / total_lux
    if lag_s <= 0.0 or math.isnan(level.reset.dead_s):
        return 0.0
    sign = 1.0 if level.key.polarity == "on" else -1.0
    part = 1.0 - _typical_dark(family) / total_lux
    reset = abs(math.log1p(part * math.expm1(sign * level.reset.contrast)))
    return left_of_reset(reset, opposite, noise, Lags(math.exp(family.ln_tau), lag_s), level.reset)


def _latencies(
    pixels: Pixels, conditions: Conditions, signal: Floats, stretch: Floats, table: Survival
) -> Floats:  # fmt: skip
    """Return (k,) the mean latency of those answers that come within the window."""
    time, missed = unanswered_over_time(pixels, conditions, signal, table, stretch)
    end = min(conditions.window_s / conditions.tau_s, float(time[-1]))
    after = int(np.searchsorted(time, end))
    inside = np.append(time[:after], end)
    part = (end - time[after - 1]) / (time[after] - time[after - 1])
    last = (1.0 - part) * missed[:, after - 1] + part * missed[:, after]
    left = np.maximum(np.concatenate((missed[:, :after], last[:, None]), axis=1), _NOTHING)
    fall = np.log(left[:, :-1] / left[:, 1:])
    # Between two times the rest falls off exponentially.
    level_mean = np.where(fall > _EVEN, (left[:, :-1] - left[:, 1:]) / np.maximum(fall, _EVEN), left[:, 1:])
    area = (level_mean * np.diff(inside)).sum(axis=1) - left[:, -1] * end
    return np.asarray(area / np.maximum(left[:, 0] - left[:, -1], _NOTHING) * conditions.tau_s)


@lru_cache(maxsize=1)
def _coarse_table() -> SurvivalTable:
    """Return the survival table with as many times as a mean latency needs, and late ones."""
    table = survival_table()
    chosen = np.unique([*range(0, table.time.size, _EVERY), table.time.size - 1])
    late = table.time[-1] * np.geomspace(1.0, _LATEST, _LATE_TIMES + 1)[1:]
    survival = np.concatenate([table.survival[chosen], [table.at(time) for time in late]])
    return SurvivalTable(np.concatenate([table.time[chosen], late]), table.barrier, table.step, survival)
