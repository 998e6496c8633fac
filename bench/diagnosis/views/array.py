"""What pixels do to each other, and what the readout does to all of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from bench.diagnosis.views.base import Statistic, View

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.diagnosis.recording import Recording

__all__ = ["Burst", "Neighbours", "Outliers"]

#: Two events of neighbours this close belong together: crosstalk comes within 10 us.
_TOGETHER_US: Final = 12
#: Events of a burst.
_BURST: Final = 16
#: A pixel stands out with this many times the mean rate of its fellows, and this many events more.
_TIMES: Final = 4.0
_EVENTS: Final = 4.0


class Neighbours(View):
    """Share of events for which a direct neighbour sent the same polarity at almost the same time."""

    id: ClassVar[str] = "neighbours"
    title: ClassVar[str] = "share of events together with a neighbour's"
    of_array: ClassVar[bool] = True

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield the share."""
        frame, n = recording.frame, recording.frame.pixels
        width = frame.point.roi.width
        place = np.flatnonzero(frame.rank >= 0)[recording.pixel]
        x, y = place % width, place // width
        together = np.zeros(recording.t_us.size, np.bool_)
        for k in range(1, min(4, recording.t_us.size)):
            near = recording.t_us[k:] - recording.t_us[:-k] <= _TOGETHER_US
            near &= (np.abs(x[k:] - x[:-k]) + np.abs(y[k:] - y[:-k])) == 1
            near &= recording.p[k:] == recording.p[:-k]
            together[k:] |= near
        top = np.bincount(recording.pixel[together], minlength=n).astype(np.float64)
        yield Statistic("both", "share", top, np.bincount(recording.pixel, minlength=n).astype(np.float64))


class Outliers(View):
    """Pixels that send far more ON events under constant light than their fellows."""

    id: ClassVar[str] = "outliers"
    title: ClassVar[str] = "share of outlying pixels"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield their share."""
        if recording.frame.constant:
            counts = recording.counts(1)
            usual = float(np.mean(np.sort(counts)[: max(int(0.9 * counts.size), 1)]))
            out = counts > _TIMES * usual + _EVENTS
            yield Statistic("on", "share", out.astype(np.float64), np.ones(counts.size))


class Burst(View):
    """Mean logarithm of the time that 16 successive events of the whole window take, while pulses are answered."""

    id: ClassVar[str] = "burst"
    title: ClassVar[str] = "mean ln(time of 16 events / 1 us)"
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
        spans = np.log(np.maximum(t[_BURST:] - t[:-_BURST], 1))[together]
        mine = window[_BURST:][together]
        top = np.bincount(mine, weights=spans, minlength=pulses).astype(np.float64)
        bottom = np.bincount(mine, minlength=pulses).astype(np.float64)
        yield Statistic("both", "mean", top, bottom, "ln", recording.frame.point.log_contrast, by_pulse=True)
