"""The recording of a point, made again by a model: the same light, window and length, other pixels and other noise.

Here, and nowhere else, the light history of a recorded point is put together.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from protocols.errors import InputError
from sim_backend.pixel.chain import build_chain
from sim_backend.pixel.light import LightHistory
from sim_backend.pixel.model import Photoconversion

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import numpy.typing as npt

    from bench.store.data import PointData, Sensor
    from sim_backend.pixel.chain import Chain
    from sim_backend.pixel.engines.base import Engine
    from sim_backend.pixel.model import PixelModel

    ModelOf = Callable[[PointData], PixelModel]

__all__ = [
    "on_sensor",
    "point_chain",
    "recorded_light",
    "recording_seed",
    "simulate_point",
    "with_recorded_dead_time",
]


def recorded_light(point: PointData) -> LightHistory:
    """Return the light on the chip as it was commanded in a point, with the filter that was in the path.

    The time axis is the camera's, in s from the start of the recording. A rise time stands in no point file: it is
    an effect of the model.

    Raises
    ------
    InputError
        The point has no stimulus, or one that does not begin at 0 s.
    """
    if not point.stimulus_t_s.size:
        raise InputError(f"{point.path}: no stimulus is recorded; expected the light level from 0 s on")
    try:
        return LightHistory(point.stimulus_t_s, point.stimulus_lux, nd_od=point.nd_od)
    except ValueError as error:
        raise InputError(f"{point.path}: {error}") from error


def on_sensor(model: PixelModel, sensor: Sensor) -> PixelModel:
    """Return the model with the photoconversion of a run's sensor: efficiency, pitch, spectrum of the light."""
    conversion = Photoconversion(sensor.quantum_efficiency, sensor.pixel_pitch_m, sensor.photons_per_lux)
    return replace(model, photoconversion=conversion)


def with_recorded_dead_time(model: PixelModel) -> ModelOf:
    """Return the model of each point: this one, with the dead time that the point's settings are believed to give.

    Where a point does not say it, the dead time is the model's.
    """

    def model_of(point: PointData) -> PixelModel:
        return replace(model, refractory_s=point.refractory_s) if math.isfinite(point.refractory_s) else model

    return model_of


def point_chain(point: PointData, model: PixelModel, sensor_seed: int, *, even: bool = False) -> Chain:
    """Return the pixels of a point's window; behind a shroud or a cap there is no stray light.

    Parameters
    ----------
    point, model, sensor_seed
        See :func:`simulate_point`.
    even
        See :class:`~sim_backend.pixel.chain.PixelDraws`.
    """
    chain = build_chain(model, point.roi, sensor_seed, even=even)
    closed = point.attributes.get("ambient", "open") != "open"
    return replace(chain, stray_lux=0.0) if closed else chain


def recording_seed(seed: int, sensor: int, point: int) -> int:
    """Return the seed of the recording of a point by one of several simulated sensors, 0 to 2^64 - 1."""
    return int(np.random.SeedSequence((seed, sensor, point)).generate_state(1, np.uint64)[0])


def simulate_point(
    point: PointData, model: PixelModel, engine: Engine, *, sensor_seed: int, seed: int
) -> Iterator[npt.NDArray[np.void]]:
    """Yield the events that a model sends when a point is taken again, as arrays of `EVENT_DTYPE` in order of time.

    Parameters
    ----------
    point
        Its light, window, ambient light and length are used; its events are not.
    model
        The pixel at the settings of this point, with the photoconversion of its sensor (:func:`on_sensor`).
    engine
        Makes the events; its grid of times is part of the model.
    sensor_seed
        Stands for the individual sensor: fixes what differs from pixel to pixel.
    seed
        Of the recording, 0 to 2^64 - 1.

    Raises
    ------
    InputError
        The point has no usable stimulus, or the engine refuses the model.
    """
    return engine.events(point_chain(point, model, sensor_seed), recorded_light(point), point.duration_s, seed)
