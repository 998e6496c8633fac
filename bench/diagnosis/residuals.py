"""What was measured beside what a model expects, in units in which the scatter of a true model is known.

Shares and counts are transformed so that their scatter hardly depends on them (Anscombe), which keeps rare events
honest: one event where 0.05 are expected is no discovery.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.summary import Label, Summary

    Floats = npt.NDArray[np.float64]

__all__ = ["Expectation", "Measured", "expectation", "measured", "slope_of"]

_ANSCOMBE: Final = 0.375
#: A transformed share or count scatters by no less than this, whatever the simulated pixels did.
_LEAST_VARIANCE: Final = 0.6
#: A mean over fewer events than this says nothing.
_FEWEST_EVENTS: Final = 12.0
#: Correlations between the statistics of a point are taken to be this much weaker than they were found.
_SHRINK: Final = 0.9
_NOTHING: Final = 1e12


@dataclass(frozen=True, slots=True)
class Measured:
    """The statistics of a run."""

    labels: tuple[Label, ...]
    points: tuple[slice, ...]  #: which statistics belong to each point
    ratio: Floats  #: (n,) as they are, in the label's unit
    bottom: Floats  #: (n,) trials, seconds, or events
    value: Floats  #: (n,) transformed
    variance: Floats  #: (n,) of the ratio, from the scatter between the clusters of the run


@dataclass(frozen=True, slots=True)
class Expectation:
    """What a model expects of a run."""

    ratio: Floats  #: (n,) in the label's unit
    value: Floats  #: (n,) transformed
    covariance: tuple[Floats, ...]  #: (k, k) of each point: of one recording, transformed
    recordings: float  #: simulated ones, which make it uncertain too

    @property
    def more(self) -> float:
        """Variance of measured less expected, beside that of a recording."""
        return 1.0 + 1.0 / self.recordings

    @property
    def deviation(self) -> Floats:
        """(n,) standard errors of measured less expected."""
        return np.concatenate([np.sqrt(np.diag(c) * self.more) for c in self.covariance])

    def roots(self) -> tuple[Floats, ...]:
        """Return for each point the matrix that makes its residuals independent, of unit variance."""
        return tuple(_whitener(c * self.more) for c in self.covariance)


def measured(summaries: Sequence[Summary]) -> Measured:
    """Return the statistics of a run, point after point."""
    labels = tuple(label for s in summaries for label in s.labels)
    ends = np.cumsum([0, *(len(s.labels) for s in summaries)])
    bottom = np.concatenate([s.bottom for s in summaries]) if summaries else np.empty(0)
    ratio = np.concatenate([s.ratio for s in summaries]) if summaries else np.empty(0)
    variance = np.concatenate([np.diag(s.covariance()) for s in summaries]) if summaries else np.empty(0)
    slices = tuple(slice(int(a), int(b)) for a, b in pairwise(ends))
    return Measured(labels, slices, ratio, bottom, _transform(labels, ratio, bottom), variance)


def expectation(of: Measured, summaries: Sequence[Summary], share: float = 1.0) -> Expectation:
    """Return what simulated recordings let expect of the run.

    Parameters
    ----------
    share
        Of the pixels that was simulated; what depends on their number is not known from a part of them.
    """
    values, ratios, covariances = [], [], []
    for where, summary in zip(of.points, summaries, strict=True):
        labels, bottom = of.labels[where], of.bottom[where]
        ratio = summary.ratio
        each = summary.bottom / summary.recordings
        slope = slope_of(labels, ratio, bottom)
        with np.errstate(invalid="ignore", divide="ignore"):
            # The scatter is that of as many trials as were measured, not of as many as were simulated.
            scale = np.sqrt(np.where(bottom > 0.0, each / np.where(bottom > 0.0, bottom, 1.0), 1.0))
        turn = slope * scale
        covariance = summary.covariance() * np.outer(turn, turn)
        covariance = _bounded(labels, covariance, bottom, summary, of.ratio[where], of.variance[where])
        covariances.append(covariance if share >= 1.0 else _without_array(labels, covariance))
        ratios.append(ratio)
        values.append(_transform(labels, ratio, bottom))
    return Expectation(
        np.concatenate(ratios), np.concatenate(values), tuple(covariances), summaries[0].recordings * share
    )


def _transform(labels: Sequence[Label], ratio: Floats, bottom: Floats) -> Floats:
    value = np.nan_to_num(ratio).copy()
    for i, label in enumerate(labels):
        n = bottom[i]
        if label.kind == "share" and n > 0.0:
            share = (value[i] * n + _ANSCOMBE) / (n + 2.0 * _ANSCOMBE)
            value[i] = 2.0 * np.sqrt(n + 0.5) * np.arcsin(np.sqrt(min(max(share, 0.0), 1.0)))
        elif label.kind == "count":
            value[i] = 2.0 * np.sqrt(max(value[i] * n, 0.0) + _ANSCOMBE)
    return value


def slope_of(labels: Sequence[Label], ratio: Floats, bottom: Floats) -> Floats:
    """Return the derivative of the transformed value by the ratio."""
    slope = np.ones(len(labels))
    known = np.nan_to_num(ratio)
    for i, label in enumerate(labels):
        n = bottom[i]
        if label.kind == "share":
            share = (known[i] * n + _ANSCOMBE) / (n + 2.0 * _ANSCOMBE) if n > 0.0 else 0.5
            slope[i] = np.sqrt(n) / np.sqrt(max(share * (1.0 - share), 1e-12)) if n > 0.0 else 0.0
        elif label.kind == "count":
            slope[i] = n / np.sqrt(max(known[i] * n, 0.0) + _ANSCOMBE)
    return slope


def _bounded(
    labels: Sequence[Label], covariance: Floats, bottom: Floats, summary: Summary, ratio: Floats, scatter: Floats
) -> Floats:
    """Return the covariance with variances that are not too small, and none where a statistic says nothing."""
    found = np.diag(covariance).copy()
    variance = found.copy()
    simulated, expected = summary.bottom, summary.ratio
    for i, label in enumerate(labels):
        if label.kind in ("share", "count"):
            variance[i] = max(variance[i], _LEAST_VARIANCE) if bottom[i] > 0.0 and simulated[i] > 0.0 else _NOTHING
        elif label.kind == "mean" and min(bottom[i], simulated[i]) < _FEWEST_EVENTS:
            variance[i] = _NOTHING
        elif label.kind in ("mean", "difference"):
            # Where the model is far off its own scatter is not to be trusted: half of each.
            variance[i] = 0.5 * (variance[i] + scatter[i]) + 2.0 * label.least**2
        if not (np.isfinite(ratio[i]) and np.isfinite(expected[i])) or variance[i] <= 0.0:
            variance[i] = _NOTHING
    kept = np.sqrt(_SHRINK * _trust(labels, summary))
    for i, label in enumerate(labels):
        if variance[i] >= _NOTHING:
            kept[i] = 0.0
        elif found[i] > variance[i] or (label.kind == "mean" and found[i] > 0.0):
            kept[i] *= np.sqrt(variance[i] / found[i])
    # What a variance was made larger by belongs to that statistic alone.
    off = covariance * np.outer(kept, kept)
    np.fill_diagonal(off, variance)
    return np.asarray(off)


def _trust(labels: Sequence[Label], summary: Summary) -> Floats:
    """Return from 0 to 1 how well the correlations of each statistic are known: not well from few events."""
    events = np.full(len(labels), np.inf)
    for i, label in enumerate(labels):
        if label.kind == "share":
            events[i] = min(summary.top[i], summary.bottom[i] - summary.top[i])
        elif label.kind == "count":
            events[i] = summary.top[i]
        elif label.kind == "mean":
            events[i] = summary.bottom[i]
    events = np.maximum(events, 0.0)
    known = np.isinf(events)
    return np.asarray(np.where(known, 1.0, events / np.where(known, 1.0, events + _FEWEST_EVENTS)))


def _without_array(labels: Sequence[Label], covariance: Floats) -> Floats:
    array = np.array([label.of_array or label.by_pulse for label in labels], dtype=np.bool_)
    found = np.where(array[:, None] | array[None, :], 0.0, covariance)
    found[array, array] = _NOTHING
    return found


def _whitener(covariance: Floats) -> Floats:
    """Return W with ``W C W^T = 1``; combinations that hardly vary are left out."""
    scale = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = values > 1e-2
    root = np.where(kept, 1.0 / np.sqrt(np.where(kept, values, 1.0)), 0.0)
    return np.asarray((root[:, None] * vectors.T) / scale)
