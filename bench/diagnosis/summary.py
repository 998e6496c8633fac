"""All views of a recording as sums over clusters, which add up over recordings of the same point."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.recording import Recording
    from bench.diagnosis.views.base import Kind, Part, View
    from bench.store.data import PointData

    Floats = npt.NDArray[np.float64]

__all__ = ["Label", "Summary", "add", "summarise"]


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


@dataclass(frozen=True, slots=True)
class Summary:
    """The k statistics of one point, of one recording or several.

    Each is the ratio of two sums over clusters; the products of the summands give its uncertainty, and that of any
    two together.
    """

    labels: tuple[Label, ...]
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

    def at(self, point: PointData) -> Summary:
        """Return what another point shows, whose law is the same."""
        here = {
            "point": point.index,
            "baseline_lux": point.baseline_lux,
            "nd_od": point.nd_od,
        }
        labels = tuple(replace(label, **here) for label in self.labels)  # type: ignore[arg-type]
        return replace(self, labels=labels)

    @property
    def ratio(self) -> Floats:
        """(k,) the statistics; NaN where nothing was there to be counted."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(self.bottom > 0.0, self.top / np.where(self.bottom > 0.0, self.bottom, 1.0), np.nan)

    def covariance(self) -> Floats:
        """(k, k) covariance of the ratios of one recording, from the scatter between clusters (delta method)."""
        k = len(self.labels)
        ratio = np.nan_to_num(self.ratio)
        bottom = np.where(self.bottom > 0.0, self.bottom, np.inf)
        turn = np.concatenate([np.diag(1.0 / bottom), -np.diag(ratio / bottom)], axis=1)
        found = turn @ self.products @ turn.T
        return np.asarray(found * self.recordings) if k else found


def summarise(recording: Recording, views: Sequence[View]) -> Summary:
    """Return what all views say about one recording.

    The clusters of two statistics are either the same pixels, or the same pulses, or independent.
    """
    point = recording.frame.point
    labels, tops, bottoms, by_pulse = [], [], [], []
    for view in views:
        for s in view.look(recording):
            labels.append(
                Label(
                    point.index,
                    view.id,
                    s.part,
                    s.kind,
                    s.unit,
                    point.baseline_lux,
                    s.log_contrast,
                    s.width_s,
                    point.nd_od,
                    s.least,
                    view.of_array,
                    s.by_pulse,
                )
            )
            tops.append(s.top)
            bottoms.append(s.bottom)
            by_pulse.append(s.by_pulse)
    k = len(labels)
    products = np.zeros((2 * k, 2 * k))
    pixels = [i for i in range(k) if not by_pulse[i]]
    if pixels:
        summands = np.concatenate([np.array([tops[i] for i in pixels]), np.array([bottoms[i] for i in pixels])])
        both = np.concatenate([pixels, np.add(pixels, k)])
        products[np.ix_(both, both)] = summands @ summands.T
    for i in np.flatnonzero(by_pulse):
        summands = np.array([tops[i], bottoms[i]])
        products[np.ix_([i, i + k], [i, i + k])] = summands @ summands.T
    return Summary(tuple(labels), np.array([t.sum() for t in tops]), np.array([b.sum() for b in bottoms]), products)


def add(summaries: Sequence[Summary]) -> Summary:
    """Return the summary of several recordings of one point."""
    total = summaries[0]
    for other in summaries[1:]:
        total = total + other
    return total
