"""A family of S-curves beside what a sensor is expected to show: means over the pixels, weighed by their scatter.

The pulses of one pixel need not be independent, nor its answers at different levels, so how well sums of residuals
are known follows from the scatter of the pixels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.characterize.family_model import Expected, Family, expected

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.characterize.levels import Level

    Floats = npt.NDArray[np.float64]

__all__ = ["Known", "Problem"]

#: Latencies hold more than the low-pass: they are believed to this part of them at the best.
_LATENCY_BELIEVED: Final = 0.01
#: A share is expected no better than a threshold that is off by this part of the noise lets it.
_BELIEVED: Final = 0.005
_ARMED_ROUNDS: Final = 3
_TINY: Final = 1e-12


@dataclass(frozen=True, slots=True)
class Known:
    """What is known beside the curves."""

    other_ratio: float  #: threshold of the other polarity / that of this one
    filter_sd: float = math.inf  #: standard error of the optical density of the filters; infinite: not known


def _armed(level: Level, share: Floats) -> float:
    """Return the share of pulses that found a pixel armed: the plateau of a level, by least squares.

    It is no number of the sensor, and differs from level to level: noise events before the pulse blind a pixel.
    """
    least, armed = 0.5 / (level.share.shape[0] * level.pulses), float(level.mean.max())
    for _ in range(_ARMED_ROUNDS):
        chance = np.clip(armed * share, least, 1.0 - least)
        weight = level.pulses / (chance * (1.0 - chance))
        armed = float((weight * share) @ level.mean / ((weight * share) @ share))
    return armed


class Problem:
    """Measured and expected means, weighed."""

    def __init__(self, levels: Sequence[Level], known: Known, start: Family, free: Sequence[str]) -> None:
        self.levels, self.known, self.start, self.free = levels, known, start, tuple(free)
        self.pixels = levels[0].share.shape[0]
        self._seen: dict[tuple[int, Family], Expected] = {}
        self.own, self.latency, self.latency_chance = self._measured()
        self.latency_sd = np.hypot(self.latency_chance, _LATENCY_BELIEVED * self.latency)
        self.mean = self.own.mean(axis=0)
        self.weight = self.law = np.ones(0)
        self.weigh(start)

    def _measured(self) -> tuple[Floats, Floats, Floats]:
        """Return each pixel's shares and products (pixels, s), the latencies (k,) and their errors."""
        columns = [level.share for level in self.levels]
        for level in self.levels:
            centred = level.share - level.share.mean(axis=0)
            both = centred[:, ::2].sum(axis=1) * centred[:, 1::2].sum(axis=1)
            columns.append(both[:, None] * self.pixels / (self.pixels - 1.0))
        latency = np.concatenate([level.latency_s for level in self.levels])
        sd = np.concatenate([level.latency_sd_s for level in self.levels])
        return np.concatenate(columns, axis=1), latency, sd

    def expect(self, family: Family) -> tuple[Floats, Floats, Floats]:
        """Return what is expected of the means (s,), of the latencies (k,), and the variance of one pixel's share."""
        seen = [self._expected(number, family) for number in range(len(self.levels))]
        share = np.concatenate(
            [_armed(level, one.share) * one.share for level, one in zip(self.levels, seen, strict=True)]
        )
        spread = np.concatenate([one.spread for one in seen])
        pulses = np.concatenate([level.pulses for level in self.levels])
        # A share of almost none or all is known no better than from half an answer more or less.
        least = 0.5 / (self.pixels * pulses)
        chance = np.clip(share, least, 1.0 - least)
        variance = chance * (1.0 - chance) / pulses + spread * (1.0 - 1.0 / pulses)
        # Of the products of one level only chance: mismatch shows above it.
        return (
            np.concatenate([share, [one.frozen for one in seen]]),
            np.concatenate([one.latency_s for one in seen]) + family.delay_s,
            variance,
        )

    def _expected(self, number: int, family: Family) -> Expected:
        """Return what a level shows without a delay; a sensor that looks the same there is not worked out again."""
        level = self.levels[number]
        alike = replace(family, delay_s=0.0, filter_od=family.filter_od if level.key.nd_od > 0.0 else 0.0)
        if (number, alike) not in self._seen:
            self._seen[number, alike] = expected(level, alike, self.known.other_ratio)
        return self._seen[number, alike]

    def weigh(self, family: Family) -> None:
        """Let each mean count by the scatter that a sensor lets expect."""
        from scipy.special import ndtri

        variance = self.expect(family)[2]
        products = self.own[:, variance.size :].var(axis=0)
        by_chance = np.concatenate([variance, np.maximum(products, _TINY)]) / self.pixels
        # The law itself is right to a small part of the noise.
        score = ndtri(np.clip(self.mean[: variance.size], _TINY, 1.0 - _TINY))
        law = np.zeros_like(by_chance)
        law[: variance.size] = (_BELIEVED * np.exp(-0.5 * score**2) / math.sqrt(2.0 * math.pi)) ** 2
        self.weight = 1.0 / (by_chance + law)
        self.law = law * self.weight

    def family(self, x: Floats) -> Family:
        """Return the sensor at some values of the free numbers."""
        return replace(self.start, **dict(zip(self.free, (float(v) for v in x), strict=True)))

    def only(self, number: int, column: Floats) -> Floats:
        """Return (r,) a column of changes, of the shares of one level alone."""
        first = sum(level.contrast.size for level in self.levels[:number])
        found = np.zeros_like(column)
        mine = slice(first, first + self.levels[number].contrast.size)
        found[mine] = column[mine]
        return found

    def scatter(self, pull: Floats) -> Floats:
        """Return (f, f) the covariance of sums of residuals with weights (r, f), from the scatter of the data.

        How far the law is believed has no part in it: it only keeps one mean that is known very well from deciding
        alone.
        """
        s, k = self.mean.size, self.latency.size
        by_pixel = (self.own - self.mean) * np.sqrt(self.weight) @ pull[:s]
        chance = by_pixel.T @ by_pixel / self.pixels / (self.pixels - 1.0)
        late = pull[s : s + k] * (self.latency_chance / self.latency_sd)[:, None]
        return np.asarray(chance + late.T @ late + pull[s + k :].T @ pull[s + k :])

    def doubt(self, pull: Floats) -> Floats:
        """Return (f, f) the same from how far the law is believed."""
        s, k = self.mean.size, self.latency.size
        late = pull[s : s + k] * np.sqrt(1.0 - (self.latency_chance / self.latency_sd) ** 2)[:, None]
        return np.asarray((pull[:s].T * self.law) @ pull[:s] + late.T @ late)

    def means(self, x: Floats) -> Floats:
        """Return (s + k,) what is expected of the means and of the latencies."""
        return np.concatenate(self.expect(self.family(x))[:2])

    def residuals(self, x: Floats) -> Floats:
        """Return what is measured less what is expected, in standard errors; then what is known beforehand."""
        off = (np.concatenate([self.mean, self.latency]) - self.means(x)) * self._by_error()
        return np.concatenate([off, -x[self._told()] / self.known.filter_sd])

    def jacobian(self, slopes: Floats) -> Floats:
        """Return (r, f) the derivatives of the residuals, from those of what is expected."""
        told = np.eye(slopes.shape[1])[self._told()]
        return np.concatenate([-slopes * self._by_error()[:, None], -told / self.known.filter_sd])

    def _by_error(self) -> Floats:
        return np.concatenate([np.sqrt(self.weight), 1.0 / self.latency_sd])

    def _told(self) -> list[int]:
        """Return the places of the numbers that are known beforehand to be about 0."""
        known = "filter_od" in self.free and math.isfinite(self.known.filter_sd)
        return [self.free.index("filter_od")] if known else []
