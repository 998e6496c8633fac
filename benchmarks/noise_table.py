"""Print the noise that gives a background rate of 0.5 or 0.02 events per pixel and second, for twelve settings.

Thresholds 0.3 in both directions, samples of 10 us, ON and OFF together. For each entry the rate is measured at a few
values of the rms around the published one, and a straight line is fitted to the logarithm of the rate over the
logarithm of the rms. The error is one sigma, from the spread of the counts between pixels, so bursts are counted as
what they are. Run with ``python benchmarks/noise_table.py [euler|exact] [events]``.

After a reset the rate is several times the lasting one, and comes down within a few mean intervals: a pixel that
memorised an outlier soon has an event, one that memorised the mean waits long. So three mean intervals go by before
events are counted.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from protocols.points import Roi
from sim_backend.pixel import LightHistory, PixelModel, ReferenceEngine, build_chain

if TYPE_CHECKING:
    import numpy.typing as npt

THETA = 0.3
#: corner in Hz, refractory period in s, rate in Hz, rms expected
TABLE = (
    (2000.0, 1e-4, 0.5, 0.0612),
    (2000.0, 1e-4, 0.02, 0.0536),
    (200.0, 1e-4, 0.5, 0.0541),
    (200.0, 1e-4, 0.02, 0.0465),
    (50.0, 1e-4, 0.5, 0.058),
    (50.0, 1e-4, 0.02, 0.0475),
    (2000.0, 1e-2, 0.5, 0.0628),
    (2000.0, 1e-2, 0.02, 0.0541),
    (200.0, 1e-2, 0.5, 0.0673),
    (200.0, 1e-2, 0.02, 0.0582),
    (50.0, 1e-2, 0.5, 0.0724),
    (50.0, 1e-2, 0.02, 0.0607),
)
ROI = Roi(0, 0, 16, 8)


@dataclass(frozen=True)
class Setting:
    """A pixel without stimulus, but for its noise, and for how long it is watched."""

    corner_hz: float
    refractory_s: float
    wait_s: float
    watch_s: float
    step: Literal["exact", "euler"]


@dataclass(frozen=True)
class Rate:
    """Events per pixel and second at one rms, and the relative error of it."""

    rms: float
    hz: float
    relative_error: float


def counts(setting: Setting, rms: float, seed: int) -> npt.NDArray[np.int64]:
    """Return the number of events of each pixel under constant light."""
    model = PixelModel(
        noise_rms=rms,
        corner_hz=setting.corner_hz,
        theta_on=THETA,
        theta_off=THETA,
        refractory_s=setting.refractory_s,
    )
    chain = build_chain(model, ROI, sensor_seed=0)
    engine = ReferenceEngine(step=setting.step)
    total = np.zeros(ROI.pixels, np.int64)
    for events in engine.events(chain, LightHistory.constant(10.0), setting.wait_s + setting.watch_s, seed):
        late = events[events["t"] >= setting.wait_s * 1e6]
        total += np.bincount(late["y"].astype(np.int64) * ROI.width + late["x"], minlength=ROI.pixels)
    return total


def measured(setting: Setting, rms: float, seed: int) -> Rate:
    """Return the rate at one rms."""
    n = counts(setting, rms, seed)
    poisson = 1.0 / np.sqrt(max(n.sum(), 1))
    spread = np.std(n, ddof=1) / np.sqrt(len(n)) / max(n.mean(), 1e-12)
    return Rate(rms, max(n.sum(), 0.5) / (ROI.pixels * setting.watch_s), float(max(spread, poisson)))


def rms_for(target_hz: float, rates: list[Rate]) -> tuple[float, float]:
    """Return the rms at which a line through log rate over log rms meets the target, and its error."""
    x = np.log([r.rms for r in rates])
    y = np.log([r.hz for r in rates]) - np.log(target_hz)
    error = np.array([r.relative_error for r in rates])
    (slope, offset), covariance = np.polyfit(x, y, 1, w=1.0 / error, cov="unscaled")
    root = -offset / slope
    gradient = np.array([root / slope, 1.0 / slope])
    return float(np.exp(root)), float(np.exp(root) * np.sqrt(gradient @ covariance @ gradient))


def main() -> None:
    """Measure and print each entry."""
    step: Literal["exact", "euler"] = "euler" if "euler" in sys.argv[1:] else "exact"
    numbers = [a for a in sys.argv[1:] if a not in ("euler", "exact")]
    events = float(numbers[0]) if numbers else 300.0
    print(f"step {step}, about {events:.0f} events at each of three rms")
    print("corner_hz  refractory_ms  target_hz  rms_expected  rms_measured  error   difference")
    for i, (corner_hz, refractory_s, target_hz, expected) in enumerate(TABLE):
        setting = Setting(corner_hz, refractory_s, 3.0 / target_hz, events / target_hz / ROI.pixels, step)
        rates = [measured(setting, expected * f, 100 * i + j) for j, f in enumerate((0.97, 1.0, 1.03))]
        rms, error = rms_for(target_hz, rates)
        print(
            f"{corner_hz:9.0f}  {refractory_s * 1e3:13.1f}  {target_hz:9.2f}  {expected:12.4f}  {rms:12.4f}  "
            f"{error:.4f}  {100 * (rms / expected - 1):+9.1f} %",
            flush=True,
        )


if __name__ == "__main__":
    main()
