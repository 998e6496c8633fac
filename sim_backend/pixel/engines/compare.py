"""Whether two engines have the same distribution of events: statistics of two recordings, and their tests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sim_backend.pixel.engines.sign_flips import sign_flip_p_values

if TYPE_CHECKING:
    import numpy.typing as npt

    from protocols.points import Roi

    Events = npt.NDArray[np.void]
    Floats = npt.NDArray[np.float64]
    Whole = npt.NDArray[np.int64]
    Values = tuple[Whole, npt.NDArray[Any]]  # pixel of each value, and the value

__all__ = ["Figures", "Pulses", "differences", "figures", "p_values"]

_ON: Final = 1
_OFF: Final = 0
#: Distributions are compared at these shares of both recordings together.
_SHARES: Final = np.array([0.001, 0.003, 0.01, 0.03, 0.07, *np.linspace(0.1, 0.9, 9), 0.93, 0.97, 0.99, 0.997, 0.999])


@dataclass(frozen=True, slots=True)
class Pulses:
    """Where in a periodic recording the pulses are: brighter ones from `start_s` on, darker ones before it."""

    roi: Roi  #: window
    period_s: float  #: s
    start_s: float  #: the bright pulse lasts from here to the end of the period, s
    periods: int  #: number of them
    tile: int = 1  #: pixels that may have to do with each other stand in squares of this width, in pixels

    @property
    def duration_s(self) -> float:
        """Length of the recording, s."""
        return self.period_s * self.periods


@dataclass(frozen=True, slots=True)
class Figures:
    """What a recording is like, in a few numbers."""

    events: float  #: of a pixel in a period
    on_response: float  #: share of the bright pulses with an ON event
    on_latency_ms: float  #: mean, of the first ON event of a bright pulse
    unasked: float  #: OFF events in bright pulses and ON events in dark ones, of a pixel in a period
    same_polarity: float  #: share of the pairs of events that follow each other in a pixel


def p_values(first: Events, second: Events, pulses: Pulses) -> dict[str, float]:
    """Return how likely differences as large as these are between two recordings of one distribution.

    What :func:`differences` says, tested by choices of signs: exact, whatever the pulses of a pixel have to do with
    each other. What is too rare to be tested has 1, or nearly.
    """
    return sign_flip_p_values(differences(first, second, pulses))


def differences(first: Events, second: Events, pulses: Pulses) -> dict[str, Floats]:
    """Return the differences of two recordings in each unit that is independent of the others, (units, columns).

    Numbers of events of each polarity, of answered pulses, of events that no pulse asked for; the spread of the
    number of events over the pixels, which is how much a pixel's events have to do with each other over long times;
    and distributions: latency of the first event of a pulse, gap between an event and the next, place in the period
    and in the recording. Each distribution is compared at some of its quantiles, pixel by pixel.
    """
    a, b = _Recording(first, pulses), _Recording(second, pulses)
    n = pulses.roi.pixels

    def counts(pixels: tuple[Whole, Whole]) -> Floats:
        one, other = (np.bincount(p, minlength=n) for p in pixels)
        return np.asarray((one - other)[:, None], np.float64)

    per_pixel = [np.bincount(r.pixel, minlength=n) for r in (a, b)]
    middle = 0.5 * (per_pixel[0] + per_pixel[1]).mean()
    by_pixel = {
        "ON events": counts((a.pixel[a.on], b.pixel[b.on])),
        "OFF events": counts((a.pixel[~a.on], b.pixel[~b.on])),
        "ON response": counts((a.answers(_ON)[0], b.answers(_ON)[0])),
        "OFF response": counts((a.answers(_OFF)[0], b.answers(_OFF)[0])),
        "events not asked for": counts((a.unasked(), b.unasked())),
        "spread of events": ((per_pixel[0] - middle) ** 2 - (per_pixel[1] - middle) ** 2)[:, None],
        "same-polarity pairs": _distribution(a.pairs(), b.pairs(), n, np.zeros(1)),
        "ON latency": _distribution(a.answers(_ON), b.answers(_ON), n),
        "OFF latency": _distribution(a.answers(_OFF), b.answers(_OFF), n),
        "gap to the next event": _distribution(a.gaps(), b.gaps(), n),
        "place in the period": _distribution((a.pixel, a.since_s), (b.pixel, b.since_s), n),
        "place in the recording": _distribution((a.pixel, a.t_s), (b.pixel, b.t_s), n),
    }
    return {name: _of_units(d, pulses) for name, d in by_pixel.items()}


def figures(events: Events, pulses: Pulses, pixels: int) -> Figures:
    """Return what the recording of some pixels is like."""
    of = _Recording(events, pulses)
    _, latency_s = of.answers(_ON)
    _, other = of.pairs()
    whole = pixels * pulses.periods
    return Figures(
        events=len(of.pixel) / whole,
        on_response=len(latency_s) / whole,
        on_latency_ms=float(latency_s.mean()) * 1e3 if len(latency_s) else np.nan,
        unasked=len(of.unasked()) / whole,
        same_polarity=float(np.mean(other == 0.0)) if len(other) else np.nan,
    )


class _Recording:
    """Events in order of pixel and of time."""

    def __init__(self, events: Events, pulses: Pulses) -> None:
        roi = pulses.roi
        pixel = (events["y"].astype(np.int64) - roi.y) * roi.width + events["x"] - roi.x
        order = np.lexsort((events["t"], pixel))
        t_us = events["t"][order].astype(np.int64)
        period, since_us = np.divmod(t_us, round(pulses.period_s * 1e6))
        bright = since_us >= round(pulses.start_s * 1e6)
        self._start_s = pulses.start_s
        self._pulse = 2 * period + bright
        self._pulses = 2 * (pulses.periods + 1)
        self._bright = bright
        self.pixel = pixel[order]
        self.on = events["p"][order] == _ON
        self.t_s = t_us * 1e-6
        self.since_s = since_us * 1e-6

    def answers(self, polarity: int) -> Values:
        """Return the first event of this polarity in each of its pulses, as pixel and latency, s."""
        bright = polarity == _ON
        mine = (self.on == bright) & (self._bright == bright)
        _, first = np.unique(self.pixel[mine] * self._pulses + self._pulse[mine], return_index=True)
        return self.pixel[mine][first], self.since_s[mine][first] - self._start_s * bright

    def unasked(self) -> Whole:
        """Return the pixels of the events that have not the polarity of their pulse."""
        return np.asarray(self.pixel[self.on != self._bright])

    def pairs(self) -> Values:
        """Return pixel of each pair of events that follow each other, and 0 for one polarity, 1 for two."""
        pair = np.diff(self.pixel) == 0
        return self.pixel[1:][pair], np.not_equal(self.on[1:], self.on[:-1])[pair].astype(np.float64)

    def gaps(self) -> Values:
        """Return pixel of each pair of events that follow each other, and the time between them, s."""
        pair = np.diff(self.pixel) == 0
        return self.pixel[1:][pair], np.diff(self.t_s)[pair]


def _distribution(first: Values, second: Values, pixels: int, edges: Floats | None = None) -> Floats:
    """Return how many more values of each pixel lie below each edge than of as many values of both together.

    The sum over the pixels is the difference of the two distributions, whatever the numbers of values. The edges are
    quantiles of both together, which do not change if the two recordings of a pixel are exchanged.
    """
    values = np.concatenate([first[1], second[1]])
    if len(values) == 0:
        return np.zeros((pixels, 1))
    if edges is None:
        edges = np.unique(np.quantile(values, _SHARES, method="inverted_cdf"))
    share = np.searchsorted(np.sort(values), edges, side="right") / len(values)
    one, other = (
        _below(v, pixels, edges) - share * np.bincount(v[0], minlength=pixels)[:, None] for v in (first, second)
    )
    return np.asarray(one - other)


def _below(values: Values, pixels: int, edges: Floats) -> Whole:
    """Return how many values of each pixel are no larger than each edge."""
    columns = len(edges) + 1
    at = values[0] * columns + np.searchsorted(edges, values[1])
    each = np.bincount(at, minlength=pixels * columns).reshape(pixels, columns)
    return np.asarray(np.cumsum(each, axis=1)[:, :-1])


def _of_units(by_pixel: Floats, pulses: Pulses) -> Floats:
    """Return the sums over the squares of pixels that may have to do with each other."""
    tile, roi = pulses.tile, pulses.roi
    if tile == 1:
        return by_pixel
    grid = by_pixel.reshape(roi.height // tile, tile, roi.width // tile, tile, -1)
    return np.asarray(grid.sum(axis=(1, 3)).reshape(-1, by_pixel.shape[1]))
