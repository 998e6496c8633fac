"""How often the comparators look, as it shows in time stamps: those of a simulation are multiples of its step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.store.data import PointData

    Floats = npt.NDArray[np.float64]

__all__ = ["time_grid_us"]

#: What waits for a readout is stamped when it has been served. After so long a pause nothing waits, us.
_PAUSE_US: Final = 200.0
#: Times between such events tell if there are so many of different length: pulses alone come back in multiples of a
#: step of their own.
_UNLIKE: Final = 100
#: Steps that are looked for, us: a camera stamps whole microseconds, and no simulation looks less often.
_SHORTEST_US: Final = 4.0
_LONGEST_US: Final = 110.0
#: Times between events that are looked at, us: first short ones, as the step is not known well enough to tell after
#: many of them, then longer ones, up to the last; so many of each, at the least and at the most.
_FIRST_US: Final = 400.0
_LONGER: Final = 8.0
_LAST_US: Final = 2e6
_FEWEST: Final = 200
_ENOUGH: Final = 2000
#: Stamps are on a grid when their phases agree so well: rounding to whole microseconds leaves
#: ``sinc(1 us / step)^2``, 0.81 at the shortest step, and chance next to nothing.
_AGREED: Final = 0.75
#: Steps that are tried differ by so much of a turn at the longest time, and by so many of these from the last best.
_TURN: Final = 0.1
_AROUND: Final = 2.0
_FIGURES: Final = 4


def time_grid_us(points: Sequence[PointData]) -> float | None:
    """Return the time between two looks of the comparators, us; None: it does not show in the time stamps.

    It is the longest step of which all times between events are multiples, of those after a pause if that can be told
    of them. Stamps are rounded to whole microseconds; the step need not be one.
    """
    times = [np.unique(events["t"].astype(np.float64)) for p in points for events in p.events()]
    after_a_pause = [t[1:][np.diff(t) > _PAUSE_US] for t in times]
    unlike = np.unique(np.concatenate([np.empty(0), *map(np.diff, after_a_pause)])).size
    found = _step_us([t - t[0] for t in after_a_pause if len(t)]) if unlike >= _UNLIKE else None
    return _step_us(times) if found is None else found


def _step_us(times: Sequence[Floats]) -> float | None:
    """Return the longest step of which times, or all that is between two of them, are multiples, us."""
    whole = int(np.gcd.reduce(np.concatenate([t.astype(np.int64) for t in times]))) if times else 0
    if _SHORTEST_US <= whole <= _LONGEST_US:
        return float(whole)
    slow, fast = 1.0 / _LONGEST_US, 1.0 / _SHORTEST_US
    longest, found = _FIRST_US, None
    while longest <= _LAST_US:
        between = _between(times, longest if found is None else longest / _LONGER, longest)
        if len(between) < _FEWEST:
            break
        apart = _TURN / longest
        rates = np.arange(slow, fast + apart, apart)
        agreed = np.abs(np.exp(2j * np.pi * np.outer(rates, between)).mean(axis=1))
        if agreed.max() < _AGREED:
            break
        # Parts of a step fit as well: the first peak is that of the whole one.
        first = int(np.argmax(agreed >= _AGREED))
        peak = first + int(np.argmax(agreed[first : first + int(2.0 / _TURN)]))
        found = 1.0 / rates[peak]
        slow, fast = rates[peak] - _AROUND * apart, rates[peak] + _AROUND * apart
        longest *= _LONGER
    return None if found is None else round(float(found), _FIGURES)


def _between(times: Sequence[Floats], shortest_us: float, longest_us: float) -> Floats:
    """Return some times between two events, in these limits; without a lower one if both are the same."""
    low = shortest_us if shortest_us < longest_us else 0.0
    found: list[Floats] = []
    count = 0
    for t in times:
        lag = 1
        while lag < len(t) and count < 4 * _ENOUGH:
            between = t[lag:] - t[:-lag]
            kept = between[(between > low) & (between <= longest_us)]
            if not len(kept) and between.min() > longest_us:
                break
            found.append(kept[:_ENOUGH])
            count += len(found[-1])
            lag *= 2
    every = np.concatenate(found) if found else np.empty(0)
    return every[:: max(len(every) // _ENOUGH, 1)][:_ENOUGH]
