"""The published noise levels, found twice: by counting events, and from the transition matrix.

The settings are those of ``noise_table.py``, which counts with the reference engine. For each setting: the published
rms, the rms of the transition matrix, the counted one with its standard error, and the seconds it took. The last two
columns are for recordings of 100 s from a reset on, thirty of which make the published rates.
Run with ``python -m benchmarks.noise_calibration [euler|exact]``.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Literal

from bench.models.noise_calibration import calibrate_noise
from benchmarks.noise_table import TABLE, THETA
from sim_backend.pixel import PixelModel

if TYPE_CHECKING:
    from bench.models.noise_calibration import NoiseCalibration


def main() -> None:
    """Find and print each entry."""
    step: Literal["exact", "euler"] = "euler" if "euler" in sys.argv[1:] else "exact"
    print("corner_hz  refractory_ms  target_hz  published  matrix   counted  error    seconds   first_100_s  error")
    for corner_hz, refractory_s, target_hz, published in TABLE:
        model = PixelModel(corner_hz=corner_hz, refractory_s=refractory_s, theta_on=THETA, theta_off=THETA)

        def find(
            wait_s: float | None,
            seconds: float | None,
            pixels: int,
            model: PixelModel = model,
            target_hz: float = target_hz,
        ) -> NoiseCalibration:
            return calibrate_noise(
                model, target_hz, lux=10.0, step=step, wait_s=wait_s, seconds=seconds, pixels=pixels
            )

        lasting, first = find(None, None, 512), find(0.0, 100.0, 2048)
        matrix = f"{lasting.matrix_rms:.5f}" if lasting.matrix_rms else "-"
        print(
            f"{corner_hz:9.0f}  {refractory_s * 1e3:13.1f}  {target_hz:9.2f}  {published:9.4f}  {matrix:>7}  "
            f"{lasting.rms:.5f}  {lasting.rms_error:.5f}  {lasting.took_s:7.1f}   {first.rms:11.5f}  "
            f"{first.rms_error:.5f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
