"""When pulses are answered."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from bench.diagnosis.views.base import Statistic, View

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

    from bench.diagnosis.recorded.recording import Answers, Recording

__all__ = ["EarlyLatency", "LateLatency", "Latency", "LatencySpread", "MedianLatency", "SecondEvent"]

#: Shorter times than this are taken as this: the event stream counts whole microseconds.
_SHORTEST_S: Final = 1e-6


class Latency(View):
    """Mean logarithm of the time from the edge to the first event."""

    id: ClassVar[str] = "latency"
    title: ClassVar[str] = "mean ln(latency / 1 s)"
    unit: ClassVar[str] = "ln s"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield it for each group of pulses."""
        for answers in _timed(recording):
            yield _mean_log(answers, answers.latency_s)


class LatencySpread(View):
    """Mean square of the step of the logarithmic latency from one answered pulse of a pixel to the next.

    Steps instead of distances from a mean: what differs between pixels, or drifts, is in other views.
    """

    id: ClassVar[str] = "latency_spread"
    title: ClassVar[str] = "mean square step of ln(latency)"
    unit: ClassVar[str] = "ln^2"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield it for each group of pulses."""
        for answers in _timed(recording):
            steps = np.diff(_log(answers.latency_s), axis=1) ** 2
            known = np.isfinite(steps)
            yield _statistic(answers, np.where(known, steps, 0.0).sum(axis=1), known.sum(axis=1))


class _Quantile(View):
    """Logarithm of the latency that a share of the answered pulses has not reached."""

    unit: ClassVar[str] = "ln s"
    fitted: ClassVar[bool] = False  # mean and spread tell as much
    share: ClassVar[float]

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield it for each group of pulses."""
        for answers in _timed(recording):
            of_sensors = recording.by_sensor(_log(answers.latency_s))
            known = np.isfinite(of_sensors)
            top = np.concatenate([_about_quantile(values, self.share) for values in of_sensors])
            yield _statistic(answers, top, known.sum(axis=2).ravel())


class EarlyLatency(_Quantile):
    """Latency that a tenth of the answers of all pixels come before, as a logarithm."""

    id: ClassVar[str] = "latency_10"
    title: ClassVar[str] = "ln(10 % quantile of latency / 1 s)"
    share: ClassVar[float] = 0.1


class MedianLatency(_Quantile):
    """Latency that half of the answers of all pixels come before, as a logarithm."""

    id: ClassVar[str] = "latency_50"
    title: ClassVar[str] = "ln(median latency / 1 s)"
    share: ClassVar[float] = 0.5


class LateLatency(_Quantile):
    """Latency that nine tenths of the answers of all pixels come before, as a logarithm."""

    id: ClassVar[str] = "latency_90"
    title: ClassVar[str] = "ln(90 % quantile of latency / 1 s)"
    share: ClassVar[float] = 0.9


class SecondEvent(View):
    """Mean logarithm of the time from the first event of an answer to the second: dead time and bandwidth."""

    id: ClassVar[str] = "second_event"
    title: ClassVar[str] = "mean ln(gap to the second event / 1 s)"
    unit: ClassVar[str] = "ln s"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield it for each group of pulses."""
        for answers in recording.groups:
            yield _mean_log(answers, answers.gap_s)


def _timed(recording: Recording) -> Sequence[Answers]:
    """Return the groups of pulses; none where the time axis was itself found from the events."""
    return recording.groups if recording.frame.point.tells_latency else ()


def _log(times_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.asarray(np.log(np.maximum(times_s, _SHORTEST_S)))


def _about_quantile(values: npt.NDArray[np.float64], share: float) -> npt.NDArray[np.float64]:
    """(n,) of each pixel the sum of what its answers stand for in a quantile; the mean over answers is the quantile.

    Each stands for the quantile and its influence on that, whose scatter between pixels is the uncertainty, as that
    of a mean is. Source: P. J. Huber, "Robust Statistics" (1981), section 3.2, influence ``(p - 1[x < q]) / f(q)``;
    1 / f, the slope of the quantile function, is read off two quantiles beside it.

    Parameters
    ----------
    values
        (n, k) of the k pulses of n pixels; NaN where a pulse was not answered.
    """
    known = np.isfinite(values)
    if not known.any():
        return np.zeros(len(values))
    beside = 0.5 * min(share, 1.0 - share)
    low, at, high = np.quantile(values[known], [share - beside, share, share + beside])
    influence = np.where(values < at, share - 1.0, share) * (high - low) / (2.0 * beside)
    # Few values, or times that are whole numbers, lie not quite in these shares on both sides.
    return np.asarray(np.where(known, at + influence - influence[known].mean(), 0.0).sum(axis=1))


def _mean_log(answers: Answers, times_s: npt.NDArray[np.float64]) -> Statistic:
    known = np.isfinite(times_s)
    return _statistic(answers, np.where(known, _log(times_s), 0.0).sum(axis=1), known.sum(axis=1))


def _statistic(answers: Answers, top: npt.NDArray[np.float64], bottom: npt.NDArray[np.integer]) -> Statistic:
    return Statistic(
        part=answers.test.polarity,
        kind="mean",
        top=top,
        bottom=bottom.astype(np.float64),
        log_contrast=answers.test.log_contrast,
        width_s=answers.test.width_s,
    )
