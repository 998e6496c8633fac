"""Print the speed of the reference engine, in millions of pixel-samples per second, best of some repeats.

First for a plain pixel, which takes the fast kernel, then for pixels with effects that need the general one.
Beside it stands a plain compiled loop with the library's normal numbers, measured in the same run: on a busy machine
look at the ratio. Run with ``python benchmarks/engine.py``.
"""

from __future__ import annotations

import time
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np

from protocols.points import Roi
from sim_backend.pixel import LightHistory, PixelModel, ReferenceEngine, build_chain
from sim_backend.pixel.effects import (
    HighPass,
    Leak,
    LightFlicker,
    LowFrequencyNoise,
    PhotoreceptorBandwidth,
    ResetNoise,
    ShotNoise,
)

if TYPE_CHECKING:
    from collections.abc import Callable

ROI = Roi(0, 0, 32, 32)
DURATION_S = 0.5
DT_S = 1e-5
REPEATS = 5
CORNERS_HZ = (50.0, 200.0, 2000.0)
SAMPLES = round(DURATION_S / DT_S)


def best_s(run: Callable[[], object], repeats: int = REPEATS) -> float:
    """Return the shortest time of `run`, s; the first call, which compiles, does not count."""
    run()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


def plain_pixel(corner_hz: float, noise_rms: float) -> PixelModel:
    """Return a pixel without effects."""
    return PixelModel(noise_rms=noise_rms, corner_hz=corner_hz, refractory_s=1e-2)


def pixels_with_effects() -> dict[str, PixelModel]:
    """Return pixels that the fast kernel cannot take, or whose light never rests."""
    base = plain_pixel(200.0, 0.05)
    two_poles = base + ShotNoise() + PhotoreceptorBandwidth()
    return {
        "flicker": base + LightFlicker(),
        "leak": base + Leak(),
        "two poles, shot noise": two_poles,
        "the same, flicker": two_poles + LightFlicker(),
        "all noises and leaks": two_poles + LowFrequencyNoise() + HighPass() + Leak() + ResetNoise(),
    }


def engine_rate(model: PixelModel, threads: int, light: LightHistory) -> float:
    """Return the pixel-samples per second of the engine."""
    chain = build_chain(model, ROI, 0)
    engine = ReferenceEngine(dt_s=DT_S, threads=threads)
    return ROI.pixels * SAMPLES / best_s(lambda: sum(len(e) for e in engine.events(chain, light, DURATION_S, 1)))


def plain_rate(corner_hz: float, noise_rms: float) -> float:
    """Return the pixel-samples per second of the plain loop, on one thread."""
    plain_loop = import_module("engine_kernels").plain_loop  # beside this script
    rho = np.exp(-2.0 * np.pi * corner_hz * DT_S)
    sigma = noise_rms * np.sqrt(1.0 - rho * rho)
    pixels = 32
    return pixels * SAMPLES / best_s(lambda: plain_loop(pixels, SAMPLES, 5.0, rho, sigma, 0.3, 1000), 3)


def main() -> None:
    """Measure and print."""
    constant = LightHistory.constant(10.0)
    edges = np.arange(0.0, DURATION_S, 0.02)
    pulses = LightHistory(edges, np.where(np.arange(len(edges)) % 2, 15.0, 10.0), rise_tau_s=1e-3)
    print(f"{ROI.width} x {ROI.height} pixels, {SAMPLES} samples; 1e6 pixel-samples per second")
    print("light      corner_hz  noise  1 thread  2 threads  plain loop  ratio (1 thread)")
    for name, light in (("constant", constant), ("pulses", pulses)):
        for corner_hz in CORNERS_HZ:
            for noise_rms in (0.05, 0.0):
                one, two = (engine_rate(plain_pixel(corner_hz, noise_rms), n, light) / 1e6 for n in (1, 2))
                plain = plain_rate(corner_hz, noise_rms) / 1e6 if name == "constant" and noise_rms else np.nan
                print(
                    f"{name:9}  {corner_hz:9.0f}  {noise_rms:5.2f}  {one:8.0f}  {two:9.0f}  {plain:10.0f}  "
                    f"{one / plain:5.1f}",
                    flush=True,
                )
    print("effects, corner 200 Hz, noise 0.05   constant light  pulses  (1 thread)")
    for name, model in pixels_with_effects().items():
        rates = [engine_rate(model, 1, light) / 1e6 for light in (constant, pulses)]
        print(f"{name:35}  {rates[0]:14.0f}  {rates[1]:6.0f}", flush=True)


if __name__ == "__main__":
    main()
