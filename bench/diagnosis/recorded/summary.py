"""All views of a recording as sums over clusters, which add up over recordings of the same point."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.recorded.recording import Recording
    from bench.diagnosis.views.base import Kind, Part, Statistic, View
    from bench.store.data import PointData

    Floats = npt.NDArray[np.float64]

__all__ = ["Label", "Summary", "add", "summarise", "summarise_each"]


@dataclass(frozen=True, slots=True)
class Label:
    """What one statistic is about."""

    point: int
    view: str
    part: Part
    kind: Kind
    unit: str
    baseline_lux: float
    log_contrast: float
    width_s: float
    nd_od: float
    least: float  #: what one rare event changes it by
    of_array: bool  #: it depends on how many pixels there are
    by_pulse: bool  #: it comes from what all pixels do in a pulse
    of_pairs: bool = False  #: it is a mean of products of two answers

    @property
    def group(self) -> tuple[int, Part, float, float]:
        """Which answers of a point it is about: several statistics are of the same."""
        return self.point, self.part, self.log_contrast, self.width_s


@dataclass(frozen=True, slots=True)
class Summary:
    """The k statistics of one point, of one recording or several.

    Each is the ratio of two sums over clusters; the products of the summands give its uncertainty, and that of any
    two together.
    """

    labels: tuple[Label, ...]  #: of a simulated recording: none, they are those of the run
    top: Floats  #: (k,) sums
    bottom: Floats  #: (k,)
    products: Floats  #: (2 k, 2 k) sums of products of the summands, tops before bottoms
    recordings: int = 1

    def __add__(self, other: Summary) -> Summary:
        """Return the summary of all recordings of both."""
        return Summary(
            self.labels,
            self.top + other.top,
            self.bottom + other.bottom,
            self.products + other.products,
            self.recordings + other.recordings,
        )

    @property
    def ratio(self) -> Floats:
        """(k,) the statistics; NaN where nothing was there to be counted."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(self.bottom > 0.0, self.top / np.where(self.bottom > 0.0, self.bottom, 1.0), np.nan)

    @property
    def clusters(self) -> Floats:
        """(k,) how many clusters each statistic comes from, if all had the same weight.

        Source: L. Kish, "Survey Sampling" (1965), effective sample size.
        """
        squares = np.diag(self.products)[len(self.top) :]
        return np.divide(self.bottom**2, squares, out=np.zeros_like(self.bottom), where=squares > 0.0)

    def covariance(self) -> Floats:
        """(k, k) covariance of the ratios of one recording, from the scatter between clusters (delta method)."""
        k = len(self.top)
        ratio = np.nan_to_num(self.ratio)
        bottom = np.where(self.bottom > 0.0, self.bottom, np.inf)
        mixed = self.products[:k, k:] * ratio
        found = self.products[:k, :k] - mixed - mixed.T + self.products[k:, k:] * np.outer(ratio, ratio)
        return np.asarray(found * (self.recordings / np.outer(bottom, bottom)))


def summarise(recording: Recording, views: Sequence[View]) -> Summary:
    """Return what all views say about a recording of one sensor."""
    seen = [(view, statistic) for view in views for statistic in view.look(recording)]
    labels = tuple(_label(recording.frame.point, view, s) for view, s in seen)
    return replace(_summaries([s for _, s in seen], recording.sensors)[0], labels=labels)


def summarise_each(recording: Recording, views: Sequence[View], *, whole: bool) -> list[Summary]:
    """Return what all views say about the recording of each sensor, without labels.

    Parameters
    ----------
    whole
        The recording is of all pixels of one sensor. Else nothing is said about what depends on how many there are.
    """
    seen: list[Statistic] = []
    for view in views:
        seen += (
            view.look(recording) if whole or not view.of_array else recording.frame.unsaid(view, recording.sensors)
        )
    return _summaries(seen, recording.sensors)


def _summaries(seen: Sequence[Statistic], sensors: int) -> list[Summary]:
    """Return the statistics of each sensor.

    The clusters of two statistics are either the same pixels, or the same pulses, or independent.
    """
    k = len(seen)
    ends = [[s.top.reshape(sensors, -1) for s in seen], [s.bottom.reshape(sensors, -1) for s in seen]]
    products = np.zeros((sensors, 2 * k, 2 * k))
    pixels = [i for i, s in enumerate(seen) if not s.by_pulse]
    for same in [pixels, *([i] for i, s in enumerate(seen) if s.by_pulse)]:
        if same:
            summands = np.stack([end[i] for end in ends for i in same], axis=1)
            both = np.concatenate([same, np.add(same, k)])
            products[:, both[:, None], both] = summands @ summands.transpose(0, 2, 1)
    top, bottom = (np.array([values.sum(axis=1) for values in end]).reshape(k, sensors).T for end in ends)
    return [Summary((), *one) for one in zip(top, bottom, products, strict=True)]


def _label(point: PointData, view: View, s: Statistic) -> Label:
    return Label(
        point.index, view.id, s.part, s.kind, view.unit, point.baseline_lux, s.log_contrast, s.width_s, point.nd_od,
        s.least, view.of_array, s.by_pulse, s.of_pairs,
    )  # fmt: skip


def add(summaries: Sequence[Summary]) -> Summary:
    """Return the summary of several recordings of one point."""
    total = summaries[0]
    for other in summaries[1:]:
        total = total + other
    return total
