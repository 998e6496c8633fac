"""Which points of a run have the same law under a model: they need be simulated only once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Sequence

    from bench.store.data import PointData
    from sim_backend.pixel.model import PixelModel

__all__ = ["once_each", "representatives"]

_Result = TypeVar("_Result")

#: Levels and times are the same when they agree to so many figures.
_FIGURES: Final = 6


def once_each(function: Callable[[PixelModel], _Result], models: Sequence[PixelModel]) -> list[_Result]:
    """Return the results for the models of all points: there are few different ones, and many points."""
    known = {key: function(model) for key, model in {id(m): m for m in models}.items()}
    return [known[id(model)] for model in models]


def representatives(points: Sequence[PointData], models: Sequence[PixelModel]) -> list[int]:
    """Return for each point the first one that has the same law.

    A pixel that sees only changes of the logarithm of the light does not know how much light there is: two points
    whose light differs by a factor, with everything else equal, are the same to it.
    """
    first: dict[Hashable, int] = {}
    laws = [(pixels, _seen(p)) for p, pixels in zip(points, once_each(_pixels, models), strict=True)]
    return [first.setdefault(i if None in law else law, i) for i, law in enumerate(laws)]


def _pixels(model: PixelModel) -> str | None:
    """Return what tells models apart whose pixels see only changes of the light; None: of one that sees more."""
    return None if any(effect.knows_light for effect in model.effects) else repr(model)


def _seen(point: PointData) -> Hashable:
    """Return what pixels see of a point that see only changes of the light; None: it is like no other.

    It is found once for each point.
    """
    known = _SEEN.get(id(point))
    if known is None or known[0] is not point:
        if len(_SEEN) >= _MOST_POINTS:
            _SEEN.clear()
        known = _SEEN[id(point)] = point, _changes(point)
    return known[1]


#: What was found of points before, by where they are in memory.
_SEEN: dict[int, tuple[PointData, Hashable]] = {}
_MOST_POINTS: Final = 4096


def _changes(point: PointData) -> Hashable:
    lux = point.stimulus_lux
    # Darkness has no logarithm: a level of 0 lux is left to itself.
    if not lux.size or np.any(lux <= 0.0):
        return None
    numbers = (
        np.round(lux / lux[0], _FIGURES),
        np.round(point.stimulus_t_s, _FIGURES),
        np.round(point.pulse_start_s, _FIGURES),
        np.round(point.pulse_stop_s, _FIGURES),
        np.round(point.pulse_log_contrast, _FIGURES),
        point.pulse_kind,
        point.pulse_valid,
        point.masked,
        point.gaps_s,
    )
    return (
        point.waveform,
        point.polarity,
        point.roi,
        round(point.duration_s, _FIGURES),
        *(n.tobytes() for n in numbers),
    )
