"""Where a stimulus lies in a recording, coarsely, and whether it could lie elsewhere just as well.

Brightening edges are looked for in the ON events, darkening ones in the OFF events: a place is good where many events
of the right polarity follow the edges and few precede them. The first stretch of the stimulus, short enough for the
clocks not to drift apart, is correlated with the whole recording; then all edges give the rate.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.alignment.places import STEP_S, AnswerCounts, Edges, Place, scored
from bench.alignment.telling import WORTH, Searched, judged

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.alignment.counts import EventCounts

    Floats = npt.NDArray[np.float64]

__all__ = ["search"]

#: Events within this time of an edge are taken for its answer, s; half the way to the next edge if that is less.
_ANSWER_S: Final = 0.02
_COARSE_STEPS: Final = 4  #: that make a bin of the correlation: 2 ms
_DRIFT_S: Final = 2e-3  #: that the first stretch may drift away from its middle
_NARROWEST_S: Final = 2e-3  #: stretches around the edges
_STRETCHES: Final = 6  #: tried until one is found in the recording
_SURE_SIGMA: Final = 16.0  #: by which the best place stands out, for no other stretch to be tried
_OTHERS: Final = 32  #: other places that are looked at


def search(
    edges: Edges,
    counts: EventCounts,
    duration_s: float,
    offset_limits_s: tuple[float, float] | None,
    rate_limit: float,
) -> Searched | None:
    """Return where `edges` lie in a recording; None if there is nothing that answers them.

    Parameters
    ----------
    duration_s
        Length of the recording, s.
    offset_limits_s
        Least and greatest offset; None: wherever half of the edges lie in the recording.
    rate_limit
        Greatest difference of the clocks' rates.
    """
    known = AnswerCounts(counts, duration_s)
    width_s = _answer_s(edges)
    limits = _limits(edges, duration_s) if offset_limits_s is None else offset_limits_s
    found = _first_stretch(edges, known, width_s, limits, rate_limit)
    if found is None:
        return None
    best, others = found
    best, rivals = _best_of_all(best, others, edges, known, width_s, limits, rate_limit)
    first = judged(best, rivals, edges, known, width_s)
    if first.second is None or first.told_edges >= 0.0:
        return first
    # The sum over all edges is for the one place, the edges that tell the two apart are for the other.
    place = _followed(first.second, edges, known, width_s, rate_limit)
    rivals = _rivals(place, [*others, best.offset_s], edges, known, width_s, limits)
    other = judged(place, rivals, edges, known, width_s)
    return max(first, other, key=lambda one: one.told_edges)


def _best_of_all(
    best: Place,
    others: list[float],
    edges: Edges,
    known: AnswerCounts,
    width_s: float,
    limits: tuple[float, float],
    rate_limit: float,
) -> tuple[Place, list[Place]]:
    """Return the best place over all edges, and its rivals: it may have been second in the first stretch."""
    best = _followed(best, edges, known, width_s, rate_limit)
    for _ in range(3):
        rivals = _rivals(best, others, edges, known, width_s, limits)
        better = max(rivals, key=_by_score, default=best)
        if better.score <= best.score:
            break
        others = [*others, best.offset_s]
        best = _followed(better, edges, known, width_s, rate_limit)
    return best, rivals


def _answer_s(edges: Edges) -> float:
    gaps = np.diff(edges.t_s)
    shortest = float(np.quantile(gaps, 0.05)) if len(gaps) else np.inf
    return max(min(_ANSWER_S, 0.5 * shortest), 2 * STEP_S)


def _limits(edges: Edges, duration_s: float) -> tuple[float, float]:
    middle = float(np.median(edges.t_s))
    return -middle, duration_s - middle


def _first_stretch(
    edges: Edges, known: AnswerCounts, width_s: float, limits: tuple[float, float], rate_limit: float
) -> tuple[Place, list[float]] | None:
    """Return the best place of the first stretch that is found, and other offsets."""
    length_s = 2.0 * _DRIFT_S / max(rate_limit, 1e-6)
    first_s, last_s = float(edges.t_s[0]), float(edges.t_s[-1])
    best: tuple[Place, list[float], float] | None = None
    for start_s in np.linspace(first_s, max(first_s, last_s - length_s), _STRETCHES):
        part = edges.part((edges.t_s >= start_s) & (edges.t_s <= start_s + length_s))
        offsets, scores = _correlated(part, known, width_s, limits)
        if not len(scores) or scores.max() <= 0.0:
            continue
        at = int(scores.argmax())
        spread = 1.4826 * float(np.median(np.abs(scores - np.median(scores))))
        # Where hardly any place has events the median spread is none: a single event then sets the scale.
        noise = max(spread, float(edges.contrast.max()))
        sigma = float(scores[at] - np.median(scores)) / noise
        if best is None or sigma > 2.0 * best[2]:
            best = Place(float(offsets[at]), 0.0, 0.0), _peaks(offsets, scores, at, width_s), sigma
        if sigma >= _SURE_SIGMA:
            break
    return None if best is None else best[:2]


def _correlated(
    edges: Edges, known: AnswerCounts, width_s: float, limits: tuple[float, float]
) -> tuple[Floats, Floats]:
    """Return offsets, and the score of `edges` at each of them, by Fourier transforms."""
    from scipy import fft

    step_s = _COARSE_STEPS * STEP_S
    steps = max(1, round(width_s / step_s))
    size = -(-known.binned.shape[1] // _COARSE_STEPS)
    span = round(float(edges.t_s[-1] - edges.t_s[0]) / step_s) + 1
    length = fft.next_fast_len(size + span + 2 * steps, real=True)
    total = np.zeros(length)
    place = np.rint((edges.t_s - edges.t_s[0]) / step_s).astype(np.int64)
    for polarity in (0, 1):
        mine = edges.up == bool(polarity)
        if not mine.any():
            continue
        train = np.bincount(place[mine], weights=edges.contrast[mine], minlength=length)
        padded = np.zeros(size * _COARSE_STEPS)
        padded[: known.binned.shape[1]] = known.binned[polarity]
        coarse = padded.reshape(size, _COARSE_STEPS).sum(axis=1)
        answers = _rise(coarse, steps, length)
        total += fft.irfft(fft.rfft(answers) * np.conj(fft.rfft(train)), length)
    lags = np.arange(length)
    lags = np.where(lags > length - span - steps, lags - length, lags)
    offsets = lags * step_s - edges.t_s[0]
    order = np.argsort(offsets)
    order = order[(offsets[order] >= limits[0] - step_s) & (offsets[order] <= limits[1] + step_s)]
    return offsets[order], total[order]


def _rise(counts: Floats, steps: int, length: int) -> Floats:
    """Return, for each bin, the counts of the `steps` bins from it on less those before it.

    Counts far above the usual answer, a flash or a burst of the read-out, are cut: one of them is not a stimulus.
    """
    high = counts[counts > 0]
    most = 10.0 * float(np.quantile(high, 0.98)) if len(high) else 0.0
    before = np.concatenate(([0.0], np.minimum(counts, most).cumsum()))
    at = np.arange(len(counts))
    last = len(counts)
    rise = np.zeros(length)
    rise[: len(counts)] = before[(at + steps).clip(max=last)] - 2.0 * before[at] + before[(at - steps).clip(min=0)]
    return rise


def _peaks(offsets: Floats, scores: Floats, best: int, width_s: float) -> list[float]:
    """Return other offsets at which the score has a high local maximum, highest first."""
    inner = (scores[1:-1] >= scores[:-2]) & (scores[1:-1] > scores[2:]) & (scores[1:-1] > WORTH * scores[best])
    at = np.flatnonzero(inner) + 1
    at = at[np.abs(offsets[at] - offsets[best]) > width_s]
    at = at[np.argsort(-scores[at], kind="stable")][:_OTHERS]
    return [float(v) for v in offsets[at]]


def _followed(place: Place, edges: Edges, known: AnswerCounts, width_s: float, rate_limit: float) -> Place:
    """Return the best place near `place`, at all rates; with ever narrower stretches around the edges.

    Where a stretch is longer than the answers, many places are equally good: of equals the one whose rate changes
    least is taken, and the next narrower stretch decides.
    """
    best, rate_reach, reach_s = place, rate_limit, 8 * STEP_S
    span_s = max(float(edges.t_s[-1] - edges.t_s[0]), STEP_S)
    for width in _narrower(width_s):
        best = _best_near(best, edges, known, width, rate_reach, reach_s, rate_limit)
        rate_reach, reach_s = min(rate_limit, width / span_s), width
    return replace(best, score=_best_score(best, edges, known, width_s).score)


def _best_score(place: Place, edges: Edges, known: AnswerCounts, width_s: float) -> Place:
    """Return the place within 3 ms that has the highest score."""
    tried = [replace(place, offset_s=place.offset_s + shift) for shift in np.arange(-6, 7) * STEP_S]
    return max(scored(tried, edges, known, width_s), key=_by_score)


def _narrower(width_s: float) -> list[float]:
    widths = [width_s]
    while widths[-1] > _NARROWEST_S:
        widths.append(max(0.4 * widths[-1], _NARROWEST_S))
    return widths


def _best_near(
    place: Place,
    edges: Edges,
    known: AnswerCounts,
    width_s: float,
    rate_reach: float,
    reach_s: float,
    rate_limit: float,
) -> Place:
    # The middle of the edges stays where it was: offset and rate are then told independently of each other.
    span_s = max(float(edges.t_s[-1] - edges.t_s[0]), STEP_S)
    pivot_s = float(edges.t_s[0]) if place.rate == 0.0 else float(edges.t_s.mean())
    steps = max(1, int(np.ceil(rate_reach * span_s / (0.5 * width_s))))
    rates = place.rate + rate_reach * np.arange(-steps, steps + 1) / steps
    rates = rates[np.abs(rates) <= rate_limit * (1.0 + 1e-9)]
    near = np.arange(-round(reach_s / STEP_S), round(reach_s / STEP_S) + 1) * STEP_S
    tried = [
        Place(float(place.offset_s + (place.rate - rate) * pivot_s + shift), float(rate), 0.0)
        for rate in rates
        for shift in near
    ]
    tried = scored(tried, edges, known, width_s)
    scores = np.array([one.score for one in tried])
    # Nearly equal scores are a plateau: its middle, not its edge.
    good = scores >= scores.max() - max(0.01 * abs(scores.max()), 1e-9)
    middle = np.array([[one.at(edges.t_s[:1])[0], one.at(edges.t_s[-1:])[0]] for one in tried])
    centre = middle[good].mean(axis=0)
    at = np.flatnonzero(good)[np.abs(middle[good] - centre).sum(axis=1).argmin()]
    return tried[int(at)]


def _rivals(
    best: Place, others: list[float], edges: Edges, known: AnswerCounts, width_s: float, limits: tuple[float, float]
) -> list[Place]:
    """Return the other places: high peaks, and shifts at which the stimulus looks most like itself."""
    drift_s = best.rate * float(edges.t_s[0])
    shifts = [offset - best.offset_s - drift_s for offset in others] + _likest_shifts(edges)
    places = []
    for shift in shifts:
        offset = best.offset_s + shift
        if limits[0] <= offset <= limits[1] and abs(shift) > width_s:
            places.append(_best_score(Place(offset, best.rate, 0.0), edges, known, width_s))
    return places


def _by_score(place: Place) -> float:
    return place.score


def _likest_shifts(edges: Edges) -> list[float]:
    """Return the shifts, s, at which most edges meet another one of the same direction; both signs."""
    shifts = []
    for direction in (False, True):
        t = edges.t_s[edges.up == direction][:200]
        between = (t[:, None] - t[None, :]).ravel()
        shifts.append(np.round(between[between > 0.0] / STEP_S).astype(np.int64))
    each, number = np.unique(np.concatenate(shifts), return_counts=True)
    likest = each[np.argsort(-number, kind="stable")][:8] * STEP_S
    return [float(v) for shift in likest for v in (-shift, shift)]
