"""Physical effects, one small file each."""

from __future__ import annotations

from sim_backend.pixel.effects.base import STAGES, Effect, Stage
from sim_backend.pixel.effects.dark_current import DarkCurrent
from sim_backend.pixel.effects.light_rise_time import LightRiseTime
from sim_backend.pixel.effects.registry import effect_class, effect_from_dict, effects
from sim_backend.pixel.effects.stray_light import StrayLight
from sim_backend.pixel.effects.threshold_mismatch import ThresholdMismatch

__all__ = [
    "STAGES",
    "DarkCurrent",
    "Effect",
    "LightRiseTime",
    "Stage",
    "StrayLight",
    "ThresholdMismatch",
    "effect_class",
    "effect_from_dict",
    "effects",
]
