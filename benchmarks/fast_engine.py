"""Print the time per pixel and second of both engines, side by side in one run, with their statistics beside it.

A square wave of 5 Hz around the threshold. Run with ``python benchmarks/fast_engine.py``.
"""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers.events.types import EVENT_DTYPE
from protocols.points import Roi
from sim_backend.pixel import FastEngine, LightHistory, PixelModel, ReferenceEngine, build_chain

if TYPE_CHECKING:
    import numpy.typing as npt

ROI = Roi(0, 0, 32, 16)
HALF_S = 0.1
PERIODS = 20
DURATION_S = 2.0 * HALF_S * PERIODS
REPEATS = 3
#: corner in Hz, theta over rms, refractory period in s, log contrast (0: constant light)
SETTINGS = [
    (corner_hz, *rest)
    for corner_hz in (5.0, 50.0, 200.0, 2000.0)
    for rest in ((4.5, 1e-2, 0.3), (4.5, 1e-4, 0.3), (6.0, 1e-2, 0.3), (4.5, 1e-2, 0.0), (2.5, 1e-3, 0.0))
]


def take(engine: Any, model: PixelModel, light: LightHistory) -> tuple[npt.NDArray[np.void], float]:
    """Return the events, and the shortest time of some repeats, microseconds per pixel and second."""
    chain = build_chain(model, ROI, 0)
    list(engine.events(chain, light, HALF_S, 1))
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        parts = list(engine.events(chain, light, DURATION_S, 1))
        times.append(time.perf_counter() - start)
    events = np.concatenate([np.empty(0, EVENT_DTYPE), *parts])
    return events, min(times) / DURATION_S / ROI.pixels * 1e6


def figures(events: npt.NDArray[np.void]) -> tuple[float, float, float]:
    """Return events per period, the fraction of pulses with an ON event, and the mean latency of the first, ms."""
    on = events[events["p"] == 1]
    period, since_us = np.divmod(on["t"].astype(np.int64), round(2.0 * HALF_S * 1e6))
    inside = since_us >= HALF_S * 1e6
    key = (on["y"].astype(np.int64) * 65536 + on["x"]) * PERIODS + period
    answered, first = np.unique(key[inside], return_index=True)
    pulses = ROI.pixels * PERIODS
    latency_ms = float(np.mean(since_us[inside][first] * 1e-3)) - HALF_S * 1e3 if len(first) else math.nan
    return len(events) / pulses, len(answered) / pulses, latency_ms


def main() -> None:
    """Measure and print."""
    print(f"{ROI.pixels} pixels, {PERIODS * ROI.pixels} periods, one thread; us per pixel and second")
    print("corner_hz  theta/rms  refractory_ms  step   reference    fast  ratio  events, response, latency_ms")
    for corner_hz, apart, refractory_s, step in SETTINGS:
        model = PixelModel(noise_rms=0.3 / apart, corner_hz=corner_hz, refractory_s=refractory_s)
        edges = np.arange(2.0 * PERIODS) * HALF_S
        light = LightHistory(edges, 10.0 * np.exp(step * (np.arange(2 * PERIODS) % 2)))
        slow, slow_us = take(ReferenceEngine(threads=1), model, light)
        fast, fast_us = take(FastEngine(threads=1), model, light)
        pairs = "  ".join(f"{a:.3f} / {b:.3f}" for a, b in zip(figures(slow), figures(fast), strict=True))
        print(
            f"{corner_hz:9.0f}  {apart:9.1f}  {refractory_s * 1e3:13.1f}  {step:4.2f}  {slow_us:10.1f}  "
            f"{fast_us:6.2f}  {slow_us / fast_us:5.1f}  {pairs}",
            flush=True,
        )


if __name__ == "__main__":
    main()
