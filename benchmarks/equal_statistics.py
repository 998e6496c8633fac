"""Compare the events of both engines at 24 settings, 1e5 pulses each: Holm's correction, family level 1e-3.

Run with ``python benchmarks/equal_statistics.py``; it ends with 1 if they differ. About five minutes on two cores.
"""

from __future__ import annotations

import math
import sys
from typing import Any

import numpy as np

from drivers.events.types import EVENT_DTYPE
from protocols.points import Roi
from sim_backend.pixel import FastEngine, LightHistory, PixelModel, ReferenceEngine, build_chain
from sim_backend.pixel.engines.compare import Pulses, p_values

ROI = Roi(0, 0, 50, 25)
HALF_S = 0.1
PERIODS = 81
PULSES = Pulses(ROI, 2.0 * HALF_S, HALF_S, PERIODS)
LEVEL = 1e-3
APART = 4.5


def square(log_contrast: float) -> LightHistory:
    """Return a square wave of 5 Hz."""
    t_s = np.arange(2 * PERIODS, dtype=np.float64) * HALF_S
    return LightHistory(t_s, np.where(np.arange(2 * PERIODS) % 2, 10.0 * math.exp(log_contrast), 10.0))


def reset_test(log_contrast: float) -> LightHistory:
    """Return reset pulses and test pulses in turn."""
    starts = (np.arange(PERIODS)[:, None] * 2.0 * HALF_S + np.array([0.0, 0.02, 0.06, HALF_S])).ravel()
    return LightHistory(starts, np.tile(10.0 * np.array([1.0, 1.5, 1.0, math.exp(log_contrast)]), PERIODS))


LIGHTS = {"square": square(0.3), "reset and test": reset_test(0.27), "constant": LightHistory.constant(10.0)}


def take(engine: Any, model: PixelModel, light: LightHistory, seed: int) -> Any:
    """Return the events of a recording."""
    parts = engine.events(build_chain(model, ROI, 0), light, 2.0 * HALF_S * PERIODS, seed)
    return np.concatenate([np.empty(0, EVENT_DTYPE), *parts])


def main() -> int:
    """Compare and print; return 1 if the engines differ."""
    found = {}
    print("corner_hz  refractory_ms  light           events per pulse   p-values")
    for corner_hz in (2000.0, 200.0, 50.0, 5.0):
        for refractory_s in (1e-4, 1e-2):
            for name, light in LIGHTS.items():
                model = PixelModel(noise_rms=0.3 / APART, corner_hz=corner_hz, refractory_s=refractory_s)
                pair = [take(e, model, light, i) for i, e in enumerate((ReferenceEngine(), FastEngine()))]
                values = p_values(pair[0], pair[1], PULSES)
                found.update({(corner_hz, refractory_s, name, k): v for k, v in values.items()})
                rates = " / ".join(f"{len(e) / ROI.pixels / PERIODS:.4f}" for e in pair)
                texts = "  ".join(f"{k} {v:.2g}" for k, v in values.items())
                print(f"{corner_hz:9.0f}  {refractory_s * 1e3:13.1f}  {name:14}  {rates}    {texts}", flush=True)
    smallest = min(found, key=lambda k: found[k])
    corrected = min(1.0, found[smallest] * len(found))
    print(f"{len(found)} tests; the smallest p, corrected: {corrected:.2g} {smallest}")
    return int(corrected < LEVEL)


if __name__ == "__main__":
    sys.exit(main())
