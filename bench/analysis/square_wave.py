"""Which of its two thresholds a square wave shows.

Both curves of a square wave step at the larger threshold: an event of the more sensitive polarity needs one of the
other before it, which moves the reference to the other level. So the curves do not tell whose threshold it is, but
their order does. After an event of the less sensitive polarity the next half period is answered almost surely, for
there the step is over the smaller threshold. After an event of the more sensitive polarity the next half is answered
only with the probability of the curve itself. Within the transition the two shares differ, unless the thresholds are
equal.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.analysis.grouping import Entry
    from bench.analysis.results import ResponsePolarity
    from bench.analysis.tally import GroupTally

__all__ = ["less_sensitive"]

_TRANSITION: Final = (0.05, 0.9)  # mean answers of the contrasts that are looked at
_SIGNIFICANT: Final = 3.3  # standard errors, over pixels
_SMALLEST_DIFFERENCE: Final = 0.03


def less_sensitive(on: Sequence[Entry], off: Sequence[Entry]) -> ResponsePolarity | None:
    """Return the polarity with the larger threshold, from the ON and OFF answers to square waves.

    Each contrast is looked at by itself; the differences are added up with the weight of their counts.

    Parameters
    ----------
    on, off
        Answers of the same pixels; of one curve each, or of several at the same settings.

    Returns
    -------
    "on", "off" or None
        None where the data do not tell: thresholds too close, or too few answers within the transition.
    """
    pairs = [(a, b) for a in on for b in off if a.point == b.point and _in_transition(a, b)]
    found = [d for d in (_difference(a.tally, b.tally) for a, b in pairs) if d is not None]
    if not found:
        return None
    weight = sum(d.weight for d in found)
    difference = sum(d.weight * d.value for d in found) / weight
    influence = np.sum([d.weight * d.influence for d in found], axis=0) / weight
    pixels = influence.size
    error = float(np.sqrt(pixels / max(pixels - 1, 1) * np.sum(influence**2)))
    if abs(difference) < max(_SMALLEST_DIFFERENCE, _SIGNIFICANT * error):
        return None
    return "on" if difference > 0 else "off"


@dataclass(frozen=True, slots=True)
class _Difference:
    """Share of OFF answers right after an ON answer, less share of ON answers right after an OFF answer."""

    value: float
    influence: npt.NDArray[np.float64]  #: (pixels,) of each pixel on the value
    weight: float


def _in_transition(on: Entry, off: Entry) -> bool:
    asked = int(on.active.sum()) * (on.tally.test.pulses + off.tally.test.pulses)
    answers = int(on.tally.answers.sum()) + int(off.tally.answers.sum())
    share = answers / asked if asked else 0.0
    return _TRANSITION[0] <= share <= _TRANSITION[1]


def _difference(on: GroupTally, off: GroupTally) -> _Difference | None:
    after_off, after_on = int(on.given.sum()), int(off.given.sum())
    if not after_off or not after_on:
        return None
    on_share, off_share = int(on.followed.sum()) / after_off, int(off.followed.sum()) / after_on
    influence = (off.followed - off_share * off.given) / after_on - (on.followed - on_share * on.given) / after_off
    return _Difference(off_share - on_share, influence, after_on * after_off / (after_on + after_off))
