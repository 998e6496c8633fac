"""A beginning that no other part of a stimulus repeats: pulses with unequal gaps.

A square wave that is shifted by one period looks like itself. Edges on the marks of a Golomb ruler do not: all
distances between two marks differ, so that two copies, one shifted, share one mark at the most.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from protocols.errors import InputError

if TYPE_CHECKING:
    import numpy.typing as npt

    from protocols.stimulus import Stimulus

__all__ = ["preamble", "with_preamble"]

#: The shortest Golomb rulers by their number of marks. An even number of edges leads back to the first level.
_RULERS: Final[dict[int, tuple[int, ...]]] = {
    4: (0, 1, 4, 6),
    6: (0, 1, 4, 10, 12, 17),
    8: (0, 1, 4, 9, 15, 22, 32, 34),
    10: (0, 1, 6, 10, 23, 26, 34, 41, 53, 55),
}
_EDGES: Final = 8
_UNIT_S: Final = 0.04


def preamble(edges: int = _EDGES, unit_s: float = _UNIT_S) -> npt.NDArray[np.float64]:
    """Return the gaps between the edges of a preamble, s: (edges - 1,), all of them different.

    Parameters
    ----------
    edges
        4, 6, 8 or 10. Eight can lose some of their answers and still tell one period from the next.
    unit_s
        The shortest gap, s; all others are multiples of it. Longer than the sensor takes to answer.
    """
    if edges not in _RULERS:
        raise InputError(f"preamble: edges: {edges}; expected one of {', '.join(map(str, _RULERS))}")
    if not unit_s > 0.0:
        raise InputError(f"preamble: unit_s: {unit_s}; expected more than 0 s")
    return unit_s * np.diff(np.array(_RULERS[edges], np.float64))


def with_preamble(
    stimulus: Stimulus,
    other_lux: float,
    *,
    edges: int = _EDGES,
    unit_s: float = _UNIT_S,
    before_s: float = 0.1,
    after_s: float = 0.1,
) -> Stimulus:
    """Return `stimulus` behind a preamble between its first level and `other_lux`.

    Parameters
    ----------
    other_lux
        The level of the pulses. The farther it is from the first level, the sooner the pixels answer, and the better
        the beginning is known: five times as bright or more, where the source can do it.
    before_s, after_s
        Time at the first level before the first pulse and after the last one, s.
    """
    first = float(stimulus.lux[0])
    if other_lux == first:
        raise InputError(f"preamble: other_lux: {other_lux} is the first level of the stimulus; expected another one")
    marks = before_s + np.concatenate(([0.0], np.cumsum(preamble(edges, unit_s))))
    shift = float(marks[-1]) + after_s
    levels = np.where(np.arange(edges) % 2 == 0, other_lux, first)
    return replace(
        stimulus,
        t_s=np.concatenate(([0.0], marks, stimulus.t_s[1:] + shift)),
        lux=np.concatenate(([first], levels, stimulus.lux[1:])),
        duration_s=stimulus.duration_s + shift,
        pulse_start_s=stimulus.pulse_start_s + shift,
        pulse_stop_s=stimulus.pulse_stop_s + shift,
    )
