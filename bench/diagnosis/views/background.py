"""What pixels send under constant light: how often, of which polarity, how regularly."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from bench.diagnosis.views.base import Part, Statistic, View

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from bench.diagnosis.recorded.recording import Recording

__all__ = ["Background", "BackgroundHalves", "BackgroundSpread", "Intervals", "Regularity", "SamePolarity"]

_POLARITIES: Final[tuple[tuple[int, Part], ...]] = ((1, "on"), (0, "off"))
#: Parts of a recording that go to two sets in turn.
_SLICES: Final = 8


class Background(View):
    """Events per pixel and second."""

    id: ClassVar[str] = "background"
    title: ClassVar[str] = "background rate, Hz"
    unit: ClassVar[str] = "Hz"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield the rate of each polarity."""
        if recording.frame.constant:
            for polarity, part in _POLARITIES:
                counts = recording.counts(polarity)
                yield Statistic(part, "count", counts, np.full(counts.size, recording.frame.observed_s))


class BackgroundHalves(View):
    """Rate in the second half of a recording less that in the first."""

    id: ClassVar[str] = "background_halves"
    title: ClassVar[str] = "background rate, second half less first, Hz"
    unit: ClassVar[str] = "Hz"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield the difference for each polarity."""
        if recording.frame.constant:
            half = recording.frame.observed_s / 2.0
            for polarity, part in _POLARITIES:
                top = recording.counts(polarity, 0.5, 1.0) - recording.counts(polarity, 0.0, 0.5)
                yield Statistic(part, "difference", top, np.full(top.size, half), least=1.0 / (half * top.size))


class BackgroundSpread(View):
    """Spread of the rate between pixels beyond chance: covariance of two sets of slices of the recording."""

    id: ClassVar[str] = "background_spread"
    title: ClassVar[str] = "variance of the background between pixels, beyond chance, Hz^2"
    unit: ClassVar[str] = "Hz^2"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield the covariance for each polarity."""
        if recording.frame.constant:
            for polarity, part in _POLARITIES:
                sets = [
                    sum(
                        (
                            recording.counts(polarity, k / _SLICES, (k + 1) / _SLICES)
                            for k in range(which, _SLICES, 2)
                        ),
                        np.zeros(recording.pixels),
                    )
                    for which in (0, 1)
                ]
                half = recording.frame.observed_s / 2.0
                away = [recording.about_mean(s) / half for s in sets]
                least = 1.0 / (half**2 * away[0].size)
                yield Statistic(part, "difference", away[0] * away[1], np.ones(away[0].size), least=least)


class SamePolarity(View):
    """Share of successive background events of a pixel that have the same polarity."""

    id: ClassVar[str] = "same_polarity"
    title: ClassVar[str] = "share of pairs of the same polarity"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield the share."""
        if recording.frame.constant:
            pixel, p, _ = _pairs(recording)
            n = recording.pixels
            same = np.bincount(pixel[p[:, 0] == p[:, 1]], minlength=n).astype(np.float64)
            yield Statistic("both", "share", same, np.bincount(pixel, minlength=n).astype(np.float64))


class Intervals(View):
    """Mean logarithm of the time between two successive ON events of a pixel (OFF events)."""

    id: ClassVar[str] = "intervals"
    title: ClassVar[str] = "mean ln(interval / 1 s)"
    unit: ClassVar[str] = "ln s"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield the mean for each polarity."""
        yield from _intervals(recording, 1)


class Regularity(View):
    """Mean square of the logarithm of the time between two successive events of one polarity.

    Beside the mean logarithm it tells how regular they are: a leak ticks, noise does not.
    """

    id: ClassVar[str] = "regularity"
    title: ClassVar[str] = "mean square of ln(interval / 1 s)"
    unit: ClassVar[str] = "(ln s)^2"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield the mean square for each polarity."""
        yield from _intervals(recording, 2)


def _intervals(recording: Recording, power: int) -> Iterator[Statistic]:
    if recording.frame.constant:
        pixel, p, gap_s = _pairs(recording)
        n = recording.pixels
        for polarity, part in _POLARITIES:
            mine = (p[:, 0] == polarity) & (p[:, 1] == polarity)
            values = np.log(np.maximum(gap_s[mine], 1e-6)) ** power
            top = np.bincount(pixel[mine], weights=values, minlength=n).astype(np.float64)
            yield Statistic(part, "mean", top, np.bincount(pixel[mine], minlength=n).astype(np.float64))


def _pairs(
    recording: Recording,
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.uint8], npt.NDArray[np.float64]]:
    """Return pixel, both polarities, and time between, of successive events of a pixel."""
    order = recording.by_pixel
    pixel, p, t = recording.pixel[order], recording.p[order], recording.t_us[order]
    same = pixel[1:] == pixel[:-1]
    return pixel[1:][same], np.stack([p[:-1][same], p[1:][same]], axis=1), np.diff(t)[same] * 1e-6
