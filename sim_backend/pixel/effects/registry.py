"""Effects by id: those that are shipped, and those of installed plug-ins."""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any, Final

from protocols.errors import InputError
from sim_backend.pixel.effects.base import Effect
from sim_backend.pixel.effects.comparator_delay import ComparatorDelay
from sim_backend.pixel.effects.contrast_error import ContrastError
from sim_backend.pixel.effects.crosstalk import Crosstalk
from sim_backend.pixel.effects.dark_current import DarkCurrent
from sim_backend.pixel.effects.event_rate_limit import EventRateLimit
from sim_backend.pixel.effects.high_pass import HighPass
from sim_backend.pixel.effects.hot_pixels import HotPixels
from sim_backend.pixel.effects.injection_offset import InjectionOffset
from sim_backend.pixel.effects.leak import Leak
from sim_backend.pixel.effects.light_drift import LightDrift
from sim_backend.pixel.effects.light_flicker import LightFlicker
from sim_backend.pixel.effects.light_rise_time import LightRiseTime
from sim_backend.pixel.effects.low_frequency_noise import LowFrequencyNoise
from sim_backend.pixel.effects.nd_error import NdError
from sim_backend.pixel.effects.parasitic_photocurrent import ParasiticPhotocurrent
from sim_backend.pixel.effects.photoreceptor_bandwidth import PhotoreceptorBandwidth
from sim_backend.pixel.effects.readout_saturation import ReadoutSaturation
from sim_backend.pixel.effects.refractory_mismatch import RefractoryMismatch
from sim_backend.pixel.effects.reset_noise import ResetNoise
from sim_backend.pixel.effects.shot_noise import ShotNoise
from sim_backend.pixel.effects.stray_light import StrayLight
from sim_backend.pixel.effects.threshold_mismatch import ThresholdMismatch
from sim_backend.pixel.effects.timestamp_jitter import TimestampJitter
from sim_backend.pixel.effects.trail_filter import TrailFilter
from sim_backend.pixel.parameters import refuse_unknown, unknown_name

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["GROUP", "effect_class", "effect_from_dict", "effects"]

#: Entry-point group of effects that other distributions bring.
GROUP: Final = "evs_bench.effects"

#: In the order in which a signal passes them.
_SHIPPED: Final[tuple[type[Effect], ...]] = (
    ContrastError,
    LightRiseTime,
    LightDrift,
    LightFlicker,
    NdError,
    StrayLight,
    DarkCurrent,
    ShotNoise,
    PhotoreceptorBandwidth,
    LowFrequencyNoise,
    HighPass,
    Leak,
    ParasiticPhotocurrent,
    ResetNoise,
    InjectionOffset,
    ThresholdMismatch,
    ComparatorDelay,
    RefractoryMismatch,
    HotPixels,
    Crosstalk,
    ReadoutSaturation,
    TimestampJitter,
    TrailFilter,
    EventRateLimit,
)


@cache
def effects() -> dict[str, type[Effect]]:
    """Return all known effects by id.

    Raises
    ------
    InputError
        A plug-in brings something that is no effect, or an id that is taken.
    """
    known: dict[str, type[Effect]] = {e.id: e for e in _SHIPPED}
    for point in entry_points(group=GROUP):
        found = point.load()
        if not (isinstance(found, type) and issubclass(found, Effect)):
            raise InputError(f"plug-in {point.name} ({point.value}): expected a class derived from Effect")
        if found.id in known:
            raise InputError(f"plug-in {point.name} ({point.value}): the id {found.id} is taken; choose another")
        known[found.id] = found
    return known


def effect_class(effect_id: str) -> type[Effect]:
    """Return the effect of that id.

    Raises
    ------
    InputError
        There is none; the message names the nearest.
    """
    known = effects()
    if effect_id not in known:
        raise InputError(unknown_name("effect", effect_id, known))
    return known[effect_id]


def effect_from_dict(effect_id: str, values: Mapping[str, Any]) -> Effect:
    """Return the effect of that id with these parameters; those that are not named have their default.

    Raises
    ------
    InputError
        The id or a parameter is unknown, or a value out of bounds.
    """
    cls = effect_class(effect_id)
    refuse_unknown(f"effect {effect_id}", values, cls)
    return cls(**values)
