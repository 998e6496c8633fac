"""Whether a stimulus could lie elsewhere in a recording just as well.

A periodic stimulus that is shifted by a period meets itself, but for a few edges: those at its ends, and those of a
preamble. They alone tell the places apart: where one place has an edge and the other has none, there must be answers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.alignment.places import AnswerCounts, Edges, Place

    Floats = npt.NDArray[np.float64]

__all__ = ["WORTH", "Searched", "judged"]

WORTH: Final = 0.25  #: of the best place's score: where another place begins to be one
_FOUND_SIGMA: Final = 6.0  #: by which the best place must stand out of what is found anywhere
_ANYWHERE: Final = 4000  #: times at which that is looked at
#: Edges that must speak for a place and against another one, net of those that speak the other way: a square wave
#: that is shifted by one period differs in two at its beginning and, answered by nothing, in two behind its end.
_TOLD_EDGES: Final = 3.5
_SILENCE: Final = 0.5  #: what an edge says by not being answered, of what it says by being answered
_TOLD_SIGMA: Final = 5.0  #: and the difference of the scores in units of the scatter of single answers
#: A place is known no better than this, and answers that come before it are answers.
_EARLIER_S: Final = 1e-3
_CLEAR_ANSWER: Final = 3.0  #: an answer so many times its scatter counts as a whole edge


@dataclass(frozen=True, slots=True)
class Searched:
    """The best place, and how sure it is."""

    place: Place
    peak_sigma: float  #: by how much the best place stands out of what is found anywhere, in units of its scatter
    second: Place | None  #: the other place that is hardest to tell from it
    told_edges: float  #: edges that speak for the best place and against that one; infinite without one
    told_sigma: float  #: difference of their scores in units of its scatter; infinite without one
    seen: npt.NDArray[np.bool_]  #: (n,) edges that were answered
    inside: npt.NDArray[np.bool_]  #: (n,) edges in the recording

    @property
    def followed(self) -> bool:
        """Whether events follow the edges clearly."""
        return self.peak_sigma >= _FOUND_SIGMA

    def doubts(self) -> list[str]:
        """Return why the place may be a wrong one; empty if it is sure."""
        doubts = []
        if not self.followed:
            doubts.append("the events do not follow the edges clearly")
        if self.second is not None and (self.told_edges < _TOLD_EDGES or self.told_sigma < _TOLD_SIGMA):
            away_ms = 1e3 * (self.second.offset_s - self.place.offset_s)
            doubts.append(
                f"the stimulus would fit {away_ms:+.0f} ms away as well, for want of a preamble that is seen"
            )
        return doubts


def judged(best: Place, rivals: Sequence[Place], edges: Edges, known: AnswerCounts, width_s: float) -> Searched:
    """Return the best place with what speaks for it and against its rivals.

    Parameters
    ----------
    known
        The events.
    width_s
        Events within this time of an edge answer it.
    """
    at_s = best.at(edges.t_s)
    inside = (at_s >= 0.0) & (at_s + width_s <= known.duration_s)
    answers = known.answers(edges, at_s - _EARLIER_S, width_s)
    typical, scatter = _typical(edges, answers, inside)
    seen = inside & (answers > 0.5 * typical) & (typical > 0.0)
    sigma = _stands_out(edges, known, width_s, answers)
    second, edges_told, sigma_told = None, np.inf, np.inf
    for rival in rivals:
        if rival.score < WORTH * best.score:
            continue
        told, apart = _told(best, rival, edges, known, width_s, typical, scatter)
        if (told, apart) < (edges_told, sigma_told):
            second, edges_told, sigma_told = rival, told, apart
    return Searched(
        place=best,
        peak_sigma=sigma,
        second=second,
        told_edges=edges_told,
        told_sigma=sigma_told,
        seen=seen,
        inside=inside,
    )


def _stands_out(edges: Edges, known: AnswerCounts, width_s: float, answers: Floats) -> float:
    """Return the score of a place by what as many edges at any other times would scatter."""
    anywhere_s = np.linspace(width_s, max(known.duration_s - width_s, width_s), _ANYWHERE)
    square = 0.0
    for direction in (False, True):
        mine = edges.up == direction
        if mine.any():
            elsewhere = known.answers(_all_of(edges, direction), anywhere_s[:, None], width_s)
            # Not a single event elsewhere still leaves the chance of one.
            square += max(float(np.square(elsewhere).mean()), 1.0) * float(np.square(edges.contrast[mine]).sum())
    return float((edges.contrast * answers).sum()) / float(np.sqrt(square))


def _all_of(edges: Edges, direction: bool) -> Edges:
    first = np.flatnonzero(edges.up == direction)[:1]
    return edges.part(first)


def _typical(edges: Edges, answers: Floats, inside: npt.NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Return, for each edge, the usual answer to edges of its kind, and how much such answers scatter around it.

    Edges whose answers were lost are not usual.
    """
    typical, scatter = np.zeros(len(answers)), np.ones(len(answers))
    for kind in np.unique(edges.kind):
        mine = edges.kind == kind
        seen = answers[mine & inside]
        if not len(seen):
            continue
        usual = float(np.quantile(seen, 0.6))
        answered = seen[seen > 0.5 * usual]
        spread = float(answered.std()) if usual > 0.0 and len(answered) else 0.0
        typical[mine], scatter[mine] = usual, max(spread, float(np.sqrt(max(usual, 1.0))))
    return typical, scatter


def _told(
    best: Place, rival: Place, edges: Edges, known: AnswerCounts, width_s: float, typical: Floats, scatter: Floats
) -> tuple[float, float]:
    """Return how many edges tell `best` from `rival`, and the difference of their scores by its scatter.

    Only edges that one of them has and the other has not say anything: those of `best` must be answered, those of
    `rival` must not be. Edges outside the recording are silent.
    """
    usable = typical > 0.0
    total, square, net = 0.0, 0.0, 0.0
    for mine, other, sign in ((best, rival, 1.0), (rival, best, -1.0)):
        at_s = mine.at(edges.t_s)
        alone = usable & ~_met(edges, at_s, other.at(edges.t_s), width_s)
        alone &= (at_s >= 0.0) & (at_s + width_s <= known.duration_s)
        answered = known.answers(edges, at_s - _EARLIER_S, width_s)[alone] / typical[alone]
        weight = np.minimum(1.0, typical[alone] / scatter[alone] / _CLEAR_ANSWER)
        yes = np.clip(2.0 * answered - 1.0, -1.0, 1.0)
        # Answers can be lost, but hardly come without an edge: that there are none says less than that there are.
        net += sign * float((weight * np.where(yes > 0.0, yes, _SILENCE * yes)).sum())
        total += sign * float((edges.contrast[alone] * answered * typical[alone]).sum())
        square += float(np.square(edges.contrast[alone] * scatter[alone]).sum())
    return net, total / float(np.sqrt(max(square, 1e-12)))


def _met(edges: Edges, at_s: Floats, other_s: Floats, width_s: float) -> npt.NDArray[np.bool_]:
    """Return which edges at `at_s` have one of their own direction of those at `other_s` near them."""
    met = np.zeros(len(at_s), np.bool_)
    for direction in (False, True):
        mine = edges.up == direction
        others = other_s[mine]
        if not len(others):
            continue
        right = np.searchsorted(others, at_s[mine]).clip(0, len(others) - 1)
        left = (right - 1).clip(0)
        gap = np.minimum(np.abs(others[right] - at_s[mine]), np.abs(others[left] - at_s[mine]))
        met[mine] = gap < width_s
    return met
