"""Where a fit starts: thresholds, noise and corner as they can be read off the brightest response curves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Hashable, Sequence

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.expected.residuals import Measured

__all__ = ["Guess", "guesses"]

#: A step is always answered above this share.
_ANSWERED: Final = 0.9
_TWO: Final = 2
#: Half of the pulses are answered so many rms before the threshold: the largest of many samples of the noise answers.
_EARLY: Final = 2.3
_NOISE: Final = (0.015, 0.12)
_CORNER_HZ: Final = (5.0, 5e3)
#: Shares of a threshold that it may be of what latencies show, and of the contrast at which responses rise: noise
#: answers before the larger one.
_OF_SHOWN: Final = (1.0, 0.7, 0.5)
_OF_RISE: Final = ((1.2, 1.2), (1.2, 0.9), (0.9, 1.2))


@dataclass(frozen=True, slots=True)
class Guess:
    """Numbers of the base pixel, by eye."""

    theta_on: float
    theta_off: float
    noise_rms: float
    corner_hz: float


@dataclass(frozen=True, slots=True)
class _Curve:
    """The responses of one polarity at one light: by contrast."""

    contrast: tuple[float, ...]
    share: tuple[float, ...]
    latency_s: tuple[float, ...]

    def crossing(self, share: float) -> float | None:
        """Return the contrast at which the response first rises to a share; None if it does not."""
        for k in range(1, len(self.contrast)):
            low, high = self.share[k - 1], self.share[k]
            if low < share <= high:
                part = (share - low) / (high - low)
                return self.contrast[k - 1] + part * (self.contrast[k] - self.contrast[k - 1])
        return None


def guesses(problem: Problem, setting: int, otherwise: Guess) -> list[Guess]:
    """Return what the brightest curves of a setting may show; `otherwise` where they show nothing.

    Latencies show thresholds larger than they are where the step before was answered more than once: the pixel does
    not remember the whole of it. Responses of a square wave rise at the larger one.
    """
    curves = {part: _brightest(problem.measured, problem.setting, setting, part) for part in ("on", "off")}
    seen = {part: _from_latencies(c) for part, c in curves.items() if c is not None}
    known = {part: pair for part, pair in seen.items() if pair is not None}
    if not known:
        return [otherwise]
    tau = float(np.median([tau for _, tau in known.values()]))
    either = float(np.mean([theta for theta, _ in known.values()]))
    on, off = (known[part][0] if part in known else either for part in ("on", "off"))
    pairs = [(a * on, b * off) for a, b in product(_OF_SHOWN, repeat=2)]
    rises = [v for part in known if (v := curves[part].crossing(0.5)) is not None]  # type: ignore[union-attr]
    rise = max(rises, default=None)
    if rise is not None:
        pairs += [(a * rise, b * rise) for a, b in _OF_RISE]
    corner_hz = float(np.clip(1.0 / (2.0 * math.pi * tau), *_CORNER_HZ))
    return [Guess(a, b, _noise(max(a, b), rise, otherwise), corner_hz) for a, b in pairs]


def _noise(theta: float, rise: float | None, otherwise: Guess) -> float:
    """Return the rms that lets half of the steps be answered at a contrast below the less sensitive threshold.

    A square wave shows one rise in both curves, at that threshold: noise answers before it.
    """
    return otherwise.noise_rms if rise is None else float(np.clip((theta - rise) / _EARLY, *_NOISE))


def _from_latencies(curve: _Curve) -> tuple[float, float] | None:
    """Return threshold and time constant, s, from the latencies of the two largest steps that are always answered.

    Behind a low-pass a step c crosses theta after ``tau ln(c / (c - theta))``: two latencies tell theta and tau.
    """
    from scipy.optimize import brentq

    answered = [
        (c, t) for c, share, t in zip(curve.contrast, curve.share, curve.latency_s, strict=True)
        if share > _ANSWERED and t > 0.0
    ]  # fmt: skip
    if len(answered) < _TWO:
        return None
    (small, later), (large, sooner) = answered[-2:]

    def excess(theta: float) -> float:
        return math.log(small / (small - theta)) / math.log(large / (large - theta)) - later / sooner

    low, high = 0.02 * small, 0.98 * small
    if small >= large or excess(low) * excess(high) >= 0.0:
        return None
    theta = float(brentq(excess, low, high))
    return theta, sooner / math.log(large / (large - theta))


def _brightest(measured: Measured, setting_of: Sequence[int], setting: int, part: str) -> _Curve | None:
    """Return the curve at the highest light, of the longest pulses."""
    shares: dict[tuple[float, float], list[int]] = {}
    latency: dict[Hashable, int] = {}
    for point, where in enumerate(measured.points):
        if setting_of[point] != setting:
            continue
        for k in range(where.start, where.stop):
            label = measured.labels[k]
            if label.part == part and label.view == "response":
                shares.setdefault((_figures(label.baseline_lux), _figures(label.width_s)), []).append(k)
            elif label.part == part and label.view == "latency":
                latency[label.group] = k
    known = [key for key, mine in shares.items() if len(mine) > 1]
    if not known:
        return None
    mine = sorted(shares[max(known)], key=lambda k: measured.labels[k].log_contrast)
    late = [latency.get(measured.labels[k].group) for k in mine]
    return _Curve(
        tuple(measured.labels[k].log_contrast for k in mine),
        tuple(float(measured.ratio[k]) for k in mine),
        tuple(math.exp(measured.ratio[k]) if k is not None else math.nan for k in late),
    )


def _figures(value: float) -> float:
    """Return a number to three figures: widths are known as they were timed."""
    return float(f"{value:.3g}")
