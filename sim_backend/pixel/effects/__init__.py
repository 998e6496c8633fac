"""Physical effects, one small file each."""

from __future__ import annotations

from sim_backend.pixel.effects.base import STAGES, Effect, Stage
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
from sim_backend.pixel.effects.registry import (
    effect_class,
    effect_from_dict,
    effect_source,
    effects,
    forget_effect_files,
    load_effect_files,
    loaded_effect_files,
)
from sim_backend.pixel.effects.reset_noise import ResetNoise
from sim_backend.pixel.effects.shot_noise import ShotNoise
from sim_backend.pixel.effects.stray_light import StrayLight
from sim_backend.pixel.effects.threshold_mismatch import ThresholdMismatch
from sim_backend.pixel.effects.timestamp_jitter import TimestampJitter
from sim_backend.pixel.effects.trail_filter import TrailFilter
from sim_backend.pixel.effects.user_file import EffectSource

__all__ = [
    "STAGES",
    "ComparatorDelay",
    "ContrastError",
    "Crosstalk",
    "DarkCurrent",
    "Effect",
    "EffectSource",
    "EventRateLimit",
    "HighPass",
    "HotPixels",
    "InjectionOffset",
    "Leak",
    "LightDrift",
    "LightFlicker",
    "LightRiseTime",
    "LowFrequencyNoise",
    "NdError",
    "ParasiticPhotocurrent",
    "PhotoreceptorBandwidth",
    "ReadoutSaturation",
    "RefractoryMismatch",
    "ResetNoise",
    "ShotNoise",
    "Stage",
    "StrayLight",
    "ThresholdMismatch",
    "TimestampJitter",
    "TrailFilter",
    "effect_class",
    "effect_from_dict",
    "effect_source",
    "effects",
    "forget_effect_files",
    "load_effect_files",
    "loaded_effect_files",
]
