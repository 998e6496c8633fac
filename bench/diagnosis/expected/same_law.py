"""Which points of a run have the same law under a model: they need be simulated only once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Hashable, Sequence

    from bench.store.data import PointData
    from sim_backend.pixel.model import PixelModel

__all__ = ["representatives"]

#: Levels and times are the same when they agree to so many figures.
_FIGURES: Final = 6


def representatives(points: Sequence[PointData], models: Sequence[PixelModel]) -> list[int]:
    """Return for each point the first one that has the same law.

    A pixel that sees only changes of the logarithm of the light does not know how much light there is: two points
    whose light differs by a factor, with everything else equal, are the same to it.
    """
    first: dict[Hashable, int] = {}
    return [first.setdefault(_law(p, m, i), i) for i, (p, m) in enumerate(zip(points, models, strict=True))]


def _law(point: PointData, model: PixelModel, index: int) -> Hashable:
    if any(effect.knows_light for effect in model.effects):
        return index
    lux = point.stimulus_lux
    # Darkness has no logarithm: a level of 0 lux is left to itself.
    if not lux.size or np.any(lux <= 0.0):
        return index
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
        repr(model),
        point.waveform,
        point.polarity,
        point.roi,
        round(point.duration_s, _FIGURES),
        *(n.tobytes() for n in numbers),
    )
