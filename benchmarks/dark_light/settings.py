"""The fifteen sensors of the study, and the family of S-curves that is taken of each."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from bench.characterize.weber import contrast_needed
from bench.store.data import Sensor
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects.registry import effect_from_dict

__all__ = ["KINDS", "ROI_PIXELS", "SENSOR", "SETTINGS", "Plan", "Setting", "plan_of"]

SENSOR: Final = Sensor("IMX636", 1280, 720, 4.86e-6, 0.6)
ROI_PIXELS: Final = 16  # to a side
KINDS: Final = ("plain", "bandwidth", "noise", "mismatch", "filter")
_DARK_FA: Final = (1.0, 5.5, 15.0)
#: Photoreceptor, Hz/fA, for each dark current: slow enough for plain readings to be wrong by a fifth or more, and not
#: so slow that a pixel memorises its reference on the way back from the reset pulse.
_HZ_PER_FA: Final = {1.0: 4.0, 5.5: 2.0, 15.0: 1.0}
_FA_PER_LUX: Final = 1.12e16 * 0.6 * 1.602176634e-4 * 4.86e-6**2
THETA_ON: Final = 0.30
_THETA_OFF: Final = 0.25
#: Light levels, lux, and the density of the filter in the path. One level is taken with and without.
_LEVELS: Final = ((0.076, 3.0), (0.152, 3.0), (0.304, 3.0), (0.304, 0.0), (3.0, 0.0), (100.0, 0.0))
_CONTRASTS: Final = 10
#: Gap, reset and test pulse, s, and the number of pulses where they are others: long for a slow photoreceptor, short
#: where a simulation takes long.
_TIMING: Final = {"bandwidth": (0.08, 0.08, 0.02, 10), "noise": (0.02, 0.02, 0.02, 15)}
_RESET: Final = 1.8  # of the contrast whose return fires an opposite event


@dataclass(frozen=True, slots=True)
class Setting:
    """A sensor."""

    kind: str
    dark_fa: float

    @property
    def name(self) -> str:
        """Its name in results."""
        return f"{self.kind}-{self.dark_fa:g}fA"

    @property
    def dark_lux(self) -> float:
        """The truth: equivalent dark illuminance."""
        return self.dark_fa / _FA_PER_LUX

    @property
    def model(self) -> PixelModel:
        """The pixel that is measured."""
        effects: dict[str, dict[str, float]] = {"dark_current": {"mean_fa": self.dark_fa, "spread": 0.0}}
        if self.kind == "bandwidth":
            effects["photoreceptor_bandwidth"] = {"hz_per_fa": _HZ_PER_FA[self.dark_fa]}
        if self.kind == "noise":
            effects["shot_noise"] = {"factor": 0.02}
        if self.kind == "mismatch":
            effects["threshold_mismatch"] = {"sigma_on": 0.03, "sigma_off": 0.03}
        if self.kind == "filter":
            effects["nd_error"] = {"delta_od": 0.1}
        model = PixelModel(
            noise_rms=0.05 if self.kind == "noise" else 0.04, theta_on=THETA_ON, theta_off=_THETA_OFF,
            corner_hz=200.0, refractory_s=0.05 if self.kind == "bandwidth" else 0.01,
        )  # fmt: skip
        for name, values in effects.items():
            model = model + effect_from_dict(name, values)
        return model


SETTINGS: Final = tuple(Setting(kind, dark) for kind in KINDS for dark in _DARK_FA)


@dataclass(frozen=True, slots=True)
class Plan:
    """The stimulus of one point."""

    baseline_lux: float
    nd_od: float
    log_contrast: float
    reset_log_contrast: float
    gap_s: float
    reset_s: float
    test_s: float
    pulses: int


def plan_of(setting: Setting) -> list[Plan]:
    """Return the points that are taken of a sensor: contrasts around the one that each level needs."""
    slow = setting.kind == "bandwidth"
    gap_s, reset_s, test_s, pulses = _TIMING.get(setting.kind, (0.03, 0.03, 0.03, 20))
    shares = np.linspace(0.45, 2.4 if slow else 1.7, _CONTRASTS)
    found = []
    for lux, nd_od in _LEVELS:
        needed = contrast_needed(THETA_ON, lux, setting.dark_lux, "on")
        reset = _RESET * contrast_needed(_THETA_OFF, lux, setting.dark_lux, "on")
        found += [Plan(lux, nd_od, float(s * needed), reset, gap_s, reset_s, test_s, pulses) for s in shares]
    if not all(math.isfinite(p.log_contrast) for p in found):
        raise ValueError(f"{setting.name}: no step reaches the threshold at one of the levels")
    return found
