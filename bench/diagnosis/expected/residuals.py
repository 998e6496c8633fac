"""What was measured beside what a model expects, in units in which the scatter of a true model is known.

Shares and counts are transformed so that their scatter hardly depends on them (Anscombe), which keeps rare events
honest: one event where 0.05 are expected is no discovery.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.recorded.summary import add

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.recorded.summary import Label, Summary

    Floats = npt.NDArray[np.float64]
    Flags = npt.NDArray[np.bool_]

__all__ = ["Expectation", "Kinds", "Measured", "Scatter", "expectation", "filled", "measured", "slope_of"]

_ANSCOMBE: Final = 0.375
_RESPONSE: Final = "response"
#: A transformed share or count scatters by no less than this, whatever the simulated pixels did.
_LEAST_VARIANCE: Final = 0.6
#: A mean over fewer events than this says nothing.
_FEWEST_EVENTS: Final = 12.0
#: and nothing is known of how it scatters where it comes from fewer clusters.
_FEWEST_CLUSTERS: Final = 3.0
#: Correlations between the statistics of a point are taken to be this much weaker than they were found.
_SHRINK: Final = 0.9
_NOTHING: Final = 1e12
#: A variance above this is that of a statistic which says nothing; a combination of statistics of which all vary by 1
#: and that itself varies by less than this hardly does.
_UNKNOWN: Final = 0.1 * _NOTHING
_HARDLY: Final = 1e-2
#: What is no share, count or time may be wrong by so many standard errors where those may be wrong by all they are.
_COARSE: Final = 30.0


@dataclass(frozen=True)
class Measured:
    """The statistics of a run."""

    labels: tuple[Label, ...]
    points: tuple[slice, ...]  #: which statistics belong to each point
    ratio: Floats  #: (n,) as they are, in the label's unit
    bottom: Floats  #: (n,) trials, seconds, or events
    value: Floats  #: (n,) transformed
    variance: Floats  #: (n,) of the ratio, from the scatter between the clusters of the run
    clusters: Floats  #: (n,) of the run, of equal weight

    @cached_property
    def kinds(self) -> Kinds:
        """What kind of statistic each is."""
        return Kinds.of(self.labels)

    @cached_property
    def families(self) -> npt.NDArray[np.int64]:
        """(n,) a number for each statistic: the same for one view of one polarity at one light."""
        known: dict[tuple[str, str, float], int] = {}
        keys = [(label.view, label.part, float(f"{label.baseline_lux:.3g}")) for label in self.labels]
        return np.array([known.setdefault(key, len(known)) for key in keys], dtype=np.int64)


@dataclass(frozen=True, slots=True)
class Kinds:
    """The kinds of n statistics, as masks."""

    share: Flags
    count: Flags
    mean: Flags
    array: Flags  #: they are not known from a part of the pixels
    least: Floats  #: what one rare event changes each by
    response: npt.NDArray[np.int64]  #: where the response is of whose answers it is about pairs; -1: it is not

    @classmethod
    def of(cls, labels: Sequence[Label]) -> Kinds:
        """Sort statistics by what they are about."""
        share, count, mean = (
            np.array([label.kind == kind for label in labels], np.bool_) for kind in ("share", "count", "mean")
        )
        array = np.array([label.of_array or label.by_pulse for label in labels], np.bool_)
        least = np.array([label.least for label in labels], np.float64)
        responses = {_pulses_of(label): i for i, label in enumerate(labels) if label.view == _RESPONSE}
        response = [responses.get(_pulses_of(label), -1) if label.of_pairs else -1 for label in labels]
        return cls(share, count, mean, array, least, np.array(response, np.int64))

    def rarer(self, ratio: Floats, bottom: Floats) -> Floats:
        """(n,) the number of answers, or of their absence, that products of two answers come from; else infinite.

        Rare ones come in clumps, in few pixels: few recordings do not tell how much such products scatter.
        """
        share = np.nan_to_num(ratio)
        number = (np.minimum(share, 1.0 - share) * bottom)[self.response]
        return np.asarray(np.where(self.response >= 0, number, np.inf))

    def by_chance(self, ratio: Floats, bottom: Floats) -> Floats:
        """(n,) the variance that means of products of two answers have if these have nothing in common; 0 for others.

        From few rare events the scatter between pixels does not tell it.
        """
        share = np.clip((np.nan_to_num(ratio) * bottom + _ANSCOMBE) / (bottom + 2.0 * _ANSCOMBE), 0.0, 1.0)
        each = (share * (1.0 - share))[self.response]
        return np.asarray(np.where(self.response >= 0, self.least * each**2, 0.0))


@dataclass(frozen=True)
class Expectation:
    """What a model expects of a run."""

    ratio: Floats  #: (n,) in the label's unit
    value: Floats  #: (n,) transformed
    scatter: Scatter  #: of one recording
    recordings: float  #: simulated ones, which make it uncertain too

    @property
    def said(self) -> Flags:
        """(n,) of what the simulated recordings said anything: of no events there is no mean."""
        return np.isfinite(self.ratio)

    def value_or(self, otherwise: Floats | float) -> Floats:
        """(n,) what is expected, transformed; something else where simulated recordings said nothing."""
        return np.where(self.said, self.value, otherwise)

    @property
    def more(self) -> float:
        """Variance of measured less expected, beside that of a recording."""
        return 1.0 + 1.0 / self.recordings

    @property
    def deviation(self) -> Floats:
        """(n,) standard errors of measured less expected."""
        return np.concatenate([np.sqrt(np.diag(c) * self.more) for c in self.scatter.covariance])

    @cached_property
    def roots(self) -> tuple[Floats, ...]:
        """Of each point the matrix that makes its residuals independent, of unit variance."""
        return tuple(_whitener(c * self.more) for c in self.scatter.covariance)

    def tolerance(self, of: Measured, share: float) -> Floats:
        """(n,) standard deviations of the expectations of a model that may be wrong.

        Parameters
        ----------
        of
            The run.
        share
            By which times, counts and angles may be wrong: relative to what they are.
        """
        kinds = of.kinds
        angle = 2.0 * np.sqrt(of.bottom + 0.5)
        count = 0.5 * np.maximum(of.value, self.value)
        ratio = kinds.share | kinds.count | kinds.mean
        wrong = np.where(kinds.share, angle, np.where(kinds.count, count, 1.0))
        return np.asarray(share * np.where(ratio, wrong, _COARSE * self.deviation))


def _pulses_of(label: Label) -> tuple[int, str, float, float]:
    return label.point, label.part, label.log_contrast, label.width_s


def measured(summaries: Sequence[Summary], labels: Sequence[Label] | None = None) -> Measured:
    """Return the statistics of a run, point after point.

    Parameters
    ----------
    labels
        What they are about, where the run was simulated and its summaries do not say so.
    """
    if labels is None:
        labels = [label for s in summaries for label in s.labels]
    ends = np.cumsum([0, *(len(s.top) for s in summaries)])
    bottom = np.concatenate([s.bottom for s in summaries]) if summaries else np.empty(0)
    ratio = np.concatenate([s.ratio for s in summaries]) if summaries else np.empty(0)
    variance = np.concatenate([np.diag(s.covariance()) for s in summaries]) if summaries else np.empty(0)
    clusters = np.concatenate([s.clusters for s in summaries]) if summaries else np.empty(0)
    slices = tuple(slice(int(a), int(b)) for a, b in pairwise(ends))
    value = _transform(Kinds.of(labels), ratio, bottom)
    return Measured(tuple(labels), slices, ratio, bottom, value, variance, clusters)


def filled(values: Floats, weight: Floats) -> Floats:
    """Return values (m, n); where one says nothing (NaN), the weighted mean of those that do; 0 where none does.

    Parameters
    ----------
    weight
        (m,) of each.
    """
    said = np.isfinite(values)
    seen = weight @ said
    mean = np.divide(weight @ np.where(said, values, 0.0), seen, out=np.zeros_like(seen), where=seen > 0.0)
    return np.where(said, values, mean)


def expectation(of: Measured, summaries: Sequence[Summary], share: float = 1.0) -> Expectation:
    """Return what simulated recordings let expect of the run.

    Parameters
    ----------
    share
        Of the pixels that was simulated; what depends on their number is not known from a part of them.
    """
    ratio = np.concatenate([s.ratio for s in summaries])
    value = _transform(of.kinds, ratio, of.bottom)
    return Expectation(ratio, value, Scatter(of, tuple(summaries), ratio, share), summaries[0].recordings * share)


class Scatter:
    """How the statistics of one recording scatter under a model; worked out when it is asked for.

    Parameters
    ----------
    of
        The run.
    summaries
        Of the simulated recordings, for each point.
    ratio
        (n,) expected, in the label's unit.
    share
        Of the pixels that was simulated.
    """

    def __init__(self, of: Measured, summaries: Sequence[Summary], ratio: Floats, share: float) -> None:
        self.summaries = tuple(summaries)
        self.ratio = ratio
        self._of, self._share = of, share

    def beside(self, others: Sequence[Scatter]) -> Scatter:
        """Return the scatter of recordings that differ little, taken together: rare events are better known.

        Parameters
        ----------
        others
            Of the same run and with as many pixels, this one among them.
        """
        together = tuple(add(column) for column in zip(*(s.summaries for s in others), strict=True))
        return Scatter(self._of, together, np.concatenate([s.ratio for s in together]), self._share)

    @cached_property
    def few(self) -> Flags:
        """(n,) means over too few simulated events to say anything, not even how much they scatter."""
        events = np.concatenate([s.bottom for s in self.summaries])
        return np.asarray(self._of.kinds.mean & (events < _FEWEST_EVENTS))

    @cached_property
    def covariance(self) -> tuple[Floats, ...]:
        """(k, k) of each point, transformed."""
        of, kinds = self._of, self._of.kinds
        top, simulated = (np.concatenate([getattr(s, end) for s in self.summaries]) for end in ("top", "bottom"))
        each = simulated / np.repeat([s.recordings for s in self.summaries], [len(s.top) for s in self.summaries])
        known = of.bottom > 0.0
        # The scatter is that of as many trials as were measured, not of as many as were simulated.
        turn = slope_of(kinds, self.ratio, of.bottom) * np.sqrt(
            np.where(known, each / np.where(known, of.bottom, 1.0), 1.0)
        )
        own = [s.covariance() for s in self.summaries]
        found = np.concatenate([np.diag(c) for c in own]) * turn**2
        clusters = np.concatenate([s.clusters for s in self.summaries])
        variance = _variance(of, found, simulated, clusters, self.ratio)
        kept = np.sqrt(_SHRINK * _trust(kinds, top, simulated))
        with np.errstate(invalid="ignore", divide="ignore"):
            narrower = np.where((found > variance) | (kinds.mean & (found > 0.0)), np.sqrt(variance / found), 1.0)
        kept = np.where(variance >= _NOTHING, 0.0, kept * narrower)
        if self._share < 1.0:
            variance, kept = np.where(kinds.array, _NOTHING, variance), np.where(kinds.array, 0.0, kept)
        factor = turn * kept
        covariances = []
        for where, c in zip(of.points, own, strict=True):
            # What a variance was made larger by belongs to that statistic alone.
            off = c * np.outer(factor[where], factor[where])
            np.fill_diagonal(off, variance[where])
            covariances.append(off)
        return tuple(covariances)


def _transform(kinds: Kinds, ratio: Floats, bottom: Floats) -> Floats:
    value = np.nan_to_num(ratio)
    share = np.clip((value * bottom + _ANSCOMBE) / (bottom + 2.0 * _ANSCOMBE), 0.0, 1.0)
    angle = 2.0 * np.sqrt(bottom + 0.5) * np.arcsin(np.sqrt(share))
    root = 2.0 * np.sqrt(np.maximum(value * bottom, 0.0) + _ANSCOMBE)
    return np.where(kinds.share & (bottom > 0.0), angle, np.where(kinds.count, root, value))


def slope_of(kinds: Kinds, ratio: Floats, bottom: Floats) -> Floats:
    """Return the derivative of the transformed value by the ratio."""
    known = np.nan_to_num(ratio)
    share = (known * bottom + _ANSCOMBE) / (bottom + 2.0 * _ANSCOMBE)
    angle = np.sqrt(bottom / np.maximum(share * (1.0 - share), 1e-12))
    root = bottom / np.sqrt(np.maximum(known * bottom, 0.0) + _ANSCOMBE)
    return np.where(kinds.share, angle, np.where(kinds.count, root, 1.0))


def _variance(of: Measured, found: Floats, simulated: Floats, clusters: Floats, expected: Floats) -> Floats:
    """Return variances that are not too small, and as good as infinite ones where a statistic says nothing."""
    kinds = of.kinds
    counted = np.where((of.bottom > 0.0) & (simulated > 0.0), np.maximum(found, _LEAST_VARIANCE), _NOTHING)
    # Where the model is far off its own scatter is not to be trusted: half of each.
    chance = kinds.by_chance(expected, of.bottom)
    mixed = 0.5 * (np.maximum(found, chance) + np.maximum(of.variance, chance)) + 2.0 * kinds.least**2
    few = np.minimum(of.bottom, simulated) < _FEWEST_EVENTS
    few = kinds.mean & (few | (np.minimum(of.clusters, clusters) < _FEWEST_CLUSTERS))
    rare = np.minimum(kinds.rarer(of.ratio, of.bottom), kinds.rarer(expected, simulated)) < _FEWEST_EVENTS
    variance = np.where(kinds.share | kinds.count, counted, np.where(few | rare, _NOTHING, mixed))
    usable = np.isfinite(of.ratio) & np.isfinite(expected) & (variance > 0.0)
    return np.where(usable, variance, _NOTHING)


def _trust(kinds: Kinds, top: Floats, bottom: Floats) -> Floats:
    """Return from 0 to 1 how well the correlations of each statistic are known: not well from few events."""
    events = np.where(kinds.share, np.minimum(top, bottom - top), np.where(kinds.count, top, bottom))
    events = np.maximum(events, 0.0)
    counted = kinds.share | kinds.count | kinds.mean
    return np.where(counted, events / (events + _FEWEST_EVENTS), 1.0)


def _whitener(covariance: Floats) -> Floats:
    """Return W with ``W C W^T = 1``; what says nothing is left out, and combinations that hardly vary."""
    own = np.diag(covariance)
    known = np.flatnonzero(own < _UNKNOWN)
    scale = np.sqrt(own[known])
    values, vectors = np.linalg.eigh(covariance[np.ix_(known, known)] / np.outer(scale, scale))
    kept = values > _HARDLY
    root = np.where(kept, 1.0 / np.sqrt(np.where(kept, values, 1.0)), 0.0)
    found = np.zeros_like(covariance)
    found[np.ix_(known, known)] = (root[:, None] * vectors.T) / scale
    return found
