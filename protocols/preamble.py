"""A beginning that no other part of a stimulus repeats: pulses with unequal gaps.

A square wave that is shifted by one period looks like itself. Edges on the marks of a Golomb ruler do not: all
distances between two marks differ, so that two copies, one shifted, share one mark at the most.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from protocols.points import Preamble
    from protocols.stimulus import Stimulus

__all__ = ["marks", "preamble_s", "with_preamble"]

#: The shortest Golomb rulers by their number of marks. An even number of edges leads back to the first level.
_RULERS: Final[dict[int, tuple[int, ...]]] = {
    4: (0, 1, 4, 6),
    6: (0, 1, 4, 10, 12, 17),
    8: (0, 1, 4, 9, 15, 22, 32, 34),
    10: (0, 1, 6, 10, 23, 26, 34, 41, 53, 55),
}
_REST_S: Final = 0.1  #: at the first level before the first pulse and after the last one


def marks(preamble: Preamble) -> npt.NDArray[np.float64]:
    """Return when the edges of a preamble come, s from its first: (edges,), all their distances different."""
    return preamble.unit_s * np.array(_RULERS[preamble.edges], np.float64)


def preamble_s(preamble: Preamble) -> float:
    """Return by how much a preamble makes a recording longer, s."""
    return float(marks(preamble)[-1]) + 2.0 * _REST_S


def with_preamble(stimulus: Stimulus, preamble: Preamble) -> Stimulus:
    """Return `stimulus` behind a preamble that starts from its first level."""
    first = float(stimulus.lux[0])
    edges_s, shift = _REST_S + marks(preamble), preamble_s(preamble)
    brighter = first * float(np.exp(preamble.log_contrast))
    levels = np.where(np.arange(preamble.edges) % 2 == 0, brighter, first)
    return replace(
        stimulus,
        t_s=np.concatenate(([0.0], edges_s, stimulus.t_s[1:] + shift)),
        lux=np.concatenate(([first], levels, stimulus.lux[1:])),
        duration_s=stimulus.duration_s + shift,
        pulse_start_s=stimulus.pulse_start_s + shift,
        pulse_stop_s=stimulus.pulse_stop_s + shift,
    )
