"""What pixels do to each other, and what the readout does to all of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from bench.diagnosis.views.base import Statistic, View

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from bench.diagnosis.recorded.recording import Recording

    Integers = npt.NDArray[np.int64]

__all__ = ["Burst", "Neighbours", "Outliers"]

#: Two events of neighbours this close belong together: crosstalk comes within 10 us.
_TOGETHER_US: Final = 12
#: So many events before an event are looked at.
_LOOKED_BACK: Final = 3
#: Of the order of events of one time: multipliers and shifts of SplitMix64 (G. L. Steele, D. Lea, C. H. Flood, "Fast
#: splittable pseudorandom number generators", OOPSLA 2014).
_GOLDEN, _FIRST, _SECOND = (np.uint64(n) for n in (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB))
_SHIFTS: Final = tuple(np.uint64(n) for n in (30, 27, 31))
_LAST_BITS: Final = np.uint64(48)
#: Events of a burst; shorter bursts than this are taken as this: how the camera cuts time is not the question.
_BURST: Final = 32
_SHORTEST_US: Final = 40
#: A pixel stands out with this many times the mean rate of its fellows, and this many events more.
_TIMES: Final = 4.0
_EVENTS: Final = 4.0


class Neighbours(View):
    """Share of events for which a direct neighbour sent the same polarity at almost the same time, beyond chance.

    Chance is what pixels do that are no neighbours: how many answer at once, and how the camera cuts time, counts for
    both alike.
    """

    id: ClassVar[str] = "neighbours"
    title: ClassVar[str] = "share of events together with a neighbour's, beyond chance"
    of_array: ClassVar[bool] = True

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield the share."""
        from bench.diagnosis.recorded.answer_kernels import count_together

        t, pixel, n, roi = recording.t_us, recording.pixel, recording.pixels, recording.frame.point.roi
        order = np.argsort((t << 16) + _shuffled(t, pixel), kind="stable")
        place = np.tile(np.flatnonzero(recording.frame.rank >= 0), recording.sensors)
        row, column = np.divmod(place, roi.width)
        top = np.zeros(n)
        count_together(
            t, pixel, recording.p, order, column, row, _TOGETHER_US, _LOOKED_BACK,
            self._chance(roi.width, roi.height), top,
        )  # fmt: skip
        bottom = np.bincount(pixel, minlength=n).astype(np.float64)
        yield Statistic("both", "difference", top, bottom, least=1.0 / max(t.size, 1))

    @staticmethod
    def _chance(width: int, height: int) -> float:
        """Return the number of pairs of neighbours beside that of all other pairs."""
        pixels = width * height
        neighbours = width * (height - 1) + height * (width - 1)
        return neighbours / max(pixels * (pixels - 1) // 2 - neighbours, 1)


def _shuffled(t: Integers, pixel: Integers) -> Integers:
    """Return (n,) numbers of 16 bits that put events of one time in an order, which is another one at other times.

    They come row by row: without another order neighbours would follow each other. Were it the same one at all times,
    so would the same pixels, and whether there are neighbours among these would be a matter of the window.
    """
    mixed = t.astype(np.uint64) * _GOLDEN + pixel.astype(np.uint64) * _FIRST
    for shift, factor in zip(_SHIFTS, (_FIRST, _SECOND, np.uint64(1)), strict=True):
        mixed = (mixed ^ (mixed >> shift)) * factor
    return (mixed >> _LAST_BITS).astype(np.int64)


class Outliers(View):
    """Pixels that send far more ON events under constant light than their fellows."""

    id: ClassVar[str] = "outliers"
    title: ClassVar[str] = "share of outlying pixels"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield their share."""
        if recording.frame.constant:
            counts = recording.counts(1)
            fellows = np.sort(recording.by_sensor(counts), axis=1)[:, : max(int(0.9 * recording.frame.pixels), 1)]
            usual = np.repeat(fellows.mean(axis=1), recording.frame.pixels)
            out = counts > _TIMES * usual + _EVENTS
            yield Statistic("on", "share", out.astype(np.float64), np.ones(counts.size))


class Burst(View):
    """Mean logarithm of the time that 32 successive events of the whole window take, while pulses are answered."""

    id: ClassVar[str] = "burst"
    title: ClassVar[str] = "mean ln(time of 32 events / 1 us)"
    unit: ClassVar[str] = "ln us"
    of_array: ClassVar[bool] = True

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield the mean; each test pulse is a cluster."""
        windows = recording.frame.windows
        if not windows.groups:
            return
        t, pulses = recording.t_us, windows.start_us.size
        window = np.searchsorted(windows.start_us, t, side="right") - 1
        inside = (window >= 0) & (t < windows.stop_us[np.maximum(window, 0)])
        together = inside[_BURST:] & inside[:-_BURST] & (window[_BURST:] == window[:-_BURST])
        spans = np.log(np.maximum(t[_BURST:] - t[:-_BURST], _SHORTEST_US))[together]
        mine = window[_BURST:][together]
        top = np.bincount(mine, weights=spans, minlength=pulses).astype(np.float64)
        bottom = np.bincount(mine, minlength=pulses).astype(np.float64)
        yield Statistic("both", "mean", top, bottom, recording.frame.point.log_contrast, by_pulse=True)
