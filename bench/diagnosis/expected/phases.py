"""The phase that a ripple of the light has in each recording, which starts at any moment of it.

Two recordings of one point differ as a whole, as the phase has it, and no average over phases is like either of them.
But the phase can be seen: beyond what repeats with the pulses, events come and go with the ripple.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.forward import engine_of
from bench.diagnosis.expected.same_law import representatives
from bench.diagnosis.recorded.ripple import locked
from bench.models.simulation import recording_seed, simulate_point
from protocols.points import Roi
from sim_backend.pixel.effects.light_flicker import LightFlicker

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.store.data import PointData
    from sim_backend.pixel.model import PixelModel

    Complex = npt.NDArray[np.complex128]

__all__ = ["phases_of", "with_phases"]

#: The window that is simulated has at most so many pixels on a side.
_SIDE: Final = 8


def with_phases(models: Sequence[PixelModel], phases: Sequence[float | None]) -> list[PixelModel]:
    """Return the models of all points; a ripple whose phase is open has that of the point, if it is known."""
    found = list(models)
    for i, (model, phase) in enumerate(zip(models, phases, strict=True)):
        one = model.effect(LightFlicker.id)
        if phase is not None and isinstance(one, LightFlicker) and one.phase is None:
            found[i] = model.changed(replace(one, phase=phase))
    return found


def phases_of(
    points: Sequence[PointData], models: Sequence[PixelModel], ripple: LightFlicker, dt_s: float, seed: int
) -> list[float | None]:  # fmt: skip
    """Return the phase of a ripple at the start of each recording, rad from 0 to 2 pi.

    The ripple is simulated at four phases, a quarter of a turn apart. Half of the difference of what opposite ones do
    to the events is what a cosine, or a sine, of the phase adds; how much of both there is in the recording tells the
    phase. None where no ripple can be seen, since it comes back with the stimulus.

    Parameters
    ----------
    models
        Of each point, without a ripple.
    ripple
        Frequency, and about how deep.
    """
    small = [_corner(point) for point in points]
    first = representatives(points, models)
    engine = engine_of(dt_s)
    locks = [locked(point, ripple.frequency_hz) for point in points]
    turning: dict[int, Complex] = {}  # (2, polarity) of cosine and sine
    for i in sorted(set(first)):
        lock, lines = locks[i], []
        if lock is None:
            continue
        for phase in (0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi):
            events = simulate_point(
                small[i], models[i] + replace(ripple, phase=phase), engine,
                sensor_seed=recording_seed(seed, 0, 0), seed=recording_seed(seed, 0, 1 + points[i].index),
            )  # fmt: skip
            lines.append(lock.amplitude(events))
        turning[i] = 0.5 * np.stack([lines[0] - lines[2], lines[1] - lines[3]])
    found: list[float | None] = []
    for i, point, lock in zip(first, points, locks, strict=True):
        if lock is None or i not in turning:
            found.append(None)
            continue
        of = lock.amplitude(point.events())
        waves = np.concatenate([turning[i].real, turning[i].imag], axis=1).T
        cosine, sine = np.linalg.lstsq(waves, np.concatenate([of.real, of.imag]), rcond=None)[0]
        found.append(float(math.atan2(sine, cosine)) % (2.0 * math.pi))
    return found


def _corner(point: PointData) -> PointData:
    roi = point.roi
    width, height = min(roi.width, _SIDE), min(roi.height, _SIDE)
    return replace(point, roi=Roi(roi.x, roi.y, width, height), masked=np.zeros((0, 2), np.uint16))
