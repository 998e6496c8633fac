"""Draw the figures of this folder: what each effect does to what can be measured, simulated with and without it.

Run with ``python docs/reference/effects/draw.py``, or name the effects to draw.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from protocols.points import Roi
from sim_backend.pixel import LightHistory, PixelModel, ReferenceEngine, build_chain
from sim_backend.pixel import effects as fx

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    Curve = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]  # x, y
    Panel = tuple[str, str, Callable[[PixelModel], list[Curve]]]  # labels of the axes; the curves of a model

FOLDER = Path(__file__).parent
ROI = Roi(0, 0, 32, 16)
QUIET = PixelModel(noise_rms=0.02, corner_hz=500.0, refractory_s=1e-3)
NOISY = dataclasses.replace(QUIET, noise_rms=0.07)
SLOW = dataclasses.replace(QUIET, corner_hz=50.0)
EDGE_S = 0.02


def events_of(model: PixelModel, light: LightHistory, duration_s: float, seed: int = 1) -> npt.NDArray[np.void]:
    """Return the events of the window."""
    chain = build_chain(model, ROI, sensor_seed=1)
    parts = list(ReferenceEngine().events(chain, light, duration_s, seed))
    return np.concatenate(parts) if parts else np.zeros(0, [("t", "i8"), ("x", "u2"), ("y", "u2"), ("p", "u1")])


def step(contrast: float, lux: float, nd_od: float = 0.0, pulse_s: float = 10.0) -> LightHistory:
    """Return a light that steps by a log contrast at EDGE_S, and back after `pulse_s`."""
    t_s = np.array([0.0, EDGE_S, EDGE_S + pulse_s])
    return LightHistory(t_s, lux * np.exp([0.0, contrast, 0.0]), nd_od=nd_od)


def s_curves(*lights_lux: float, signs: tuple[int, ...] = (1,), nd_od: float = 0.0, most: float = 1.0) -> Panel:
    """Response probability within 40 ms against log contrast."""
    contrasts = np.linspace(0.02, most, 22)

    def curve(model: PixelModel, lux: float, sign: int) -> Curve:
        probability = []
        for contrast in contrasts:
            events = events_of(model, step(sign * contrast, lux, nd_od), EDGE_S + 0.04)
            answers = events[(events["t"] >= EDGE_S * 1e6) & (events["p"] == (1 if sign > 0 else 0))]
            probability.append(len(np.unique(answers["y"].astype(int) * 4096 + answers["x"])) / ROI.pixels)
        return contrasts, np.array(probability)

    return (
        "log contrast",
        "response probability",
        lambda model: [curve(model, lux, sign) for lux in lights_lux for sign in signs],
    )


def latencies(contrast: float, most_s: float, lux: float = 10.0) -> Panel:
    """ON events against the time since the edge."""
    bins = np.linspace(0.0, most_s, 60)

    def curves(model: PixelModel) -> list[Curve]:
        events = events_of(model, step(contrast, lux), EDGE_S + most_s)
        since_s = events["t"][events["p"] == 1] * 1e-6 - EDGE_S
        return [(bins[:-1] * 1e3, np.histogram(since_s, bins)[0] / ROI.pixels)]

    return "time since the edge (ms)", "ON events per pixel", curves


def over_time(light: LightHistory, duration_s: float, bins: int = 60) -> Panel:
    """Events of either polarity against time; OFF events are drawn downwards."""
    edges = np.linspace(0.0, duration_s, bins)

    def curves(model: PixelModel) -> list[Curve]:
        events = events_of(model, light, duration_s)
        per_s = 1.0 / ROI.pixels / (edges[1] - edges[0])
        return [
            (edges[:-1], sign * per_s * np.histogram(events["t"][events["p"] == p] * 1e-6, edges)[0])
            for p, sign in ((1, 1.0), (0, -1.0))
        ]

    return "time (s)", "OFF <- rate (Hz) -> ON", curves


def over_light(duration_s: float = 0.5) -> Panel:
    """Rate of background events against the light."""
    lights_lux = np.geomspace(0.1, 300.0, 10)

    def curves(model: PixelModel) -> list[Curve]:
        events = [events_of(model, LightHistory.constant(lux), duration_s) for lux in lights_lux]
        return [(np.log10(lights_lux), np.array([len(e) / ROI.pixels / duration_s for e in events]))]

    return "log10 of the light (lux)", "background rate (Hz)", curves


def pixels(lux: float, duration_s: float) -> Panel:
    """Rate of each pixel, from the busiest to the quietest."""

    def curves(model: PixelModel) -> list[Curve]:
        events = events_of(model, LightHistory.constant(lux), duration_s)
        counts = np.bincount(events["y"].astype(int) * ROI.width + events["x"], minlength=ROI.pixels)
        return [(np.arange(ROI.pixels, dtype=float), np.sort(counts)[::-1] / duration_s)]

    return "pixel, by its rate", "rate (Hz)", curves


def neighbours(duration_s: float) -> Panel:
    """Pairs of events in direct neighbours against the time between them."""
    bins = np.linspace(0.0, 100.0, 21)

    def curves(model: PixelModel) -> list[Curve]:
        events = events_of(model, LightHistory.constant(10.0), duration_s)
        t, x, y = events["t"], events["x"].astype(int), events["y"].astype(int)
        found = []
        for k in range(1, 40):
            near = np.abs(x[k:] - x[:-k]) + np.abs(y[k:] - y[:-k]) == 1
            found.append((t[k:] - t[:-k])[near])
        return [(bins[:-1], np.histogram(np.concatenate(found), bins)[0].astype(float))]

    return "time between events in neighbours (us)", "pairs", curves


#: For each effect: the pixel without it, the effect, and what is drawn.
FIGURES: dict[str, tuple[PixelModel, fx.Effect, Panel]] = {
    "contrast_error": (QUIET, fx.ContrastError(gain_error=0.2), s_curves(10.0, most=0.6)),
    "light_rise_time": (QUIET, fx.LightRiseTime(tau_s=1e-3), latencies(0.5, 6e-3)),
    "light_drift": (QUIET, fx.LightDrift(rate_per_s=0.8), over_time(LightHistory.constant(10.0), 1.5)),
    "light_flicker": (NOISY, fx.LightFlicker(depth=0.1), over_time(LightHistory.constant(10.0), 0.06)),
    "nd_error": (QUIET + fx.DarkCurrent(), fx.NdError(delta_od=0.2), s_curves(0.1, nd_od=3.0)),
    "stray_light": (QUIET, fx.StrayLight(illuminance_lux=0.2), s_curves(0.1, 30.0)),
    "dark_current": (QUIET, fx.DarkCurrent(), s_curves(0.1, 30.0)),
    "shot_noise": (QUIET, fx.ShotNoise(), over_light()),
    "photoreceptor_bandwidth": (QUIET, fx.PhotoreceptorBandwidth(hz_per_fa=1.0), latencies(0.8, 0.03, lux=1.0)),
    "low_frequency_noise": (QUIET, fx.LowFrequencyNoise(rms=0.3, tau_s=1.0), pixels(10.0, 2.0)),
    "high_pass": (QUIET, fx.HighPass(corner_hz=3.0), over_time(step(0.9, 10.0, pulse_s=0.4), 0.8)),
    "leak": (QUIET, fx.Leak(rate_per_s=1.5, spread=0.05), over_time(LightHistory.constant(10.0), 1.5)),
    "parasitic_photocurrent": (QUIET, fx.ParasiticPhotocurrent(rate_per_s_per_lux=0.02), over_light()),
    "reset_noise": (QUIET, fx.ResetNoise(rms=0.06), s_curves(10.0, most=0.6)),
    "injection_offset": (QUIET, fx.InjectionOffset(offset=0.08), s_curves(10.0, signs=(1, -1), most=0.6)),
    "threshold_mismatch": (QUIET, fx.ThresholdMismatch(sigma_on=0.06, sigma_off=0.06), s_curves(10.0, most=0.6)),
    "comparator_delay": (QUIET, fx.ComparatorDelay(delay_s=1e-3), latencies(0.5, 6e-3)),
    "refractory_mismatch": (SLOW, fx.RefractoryMismatch(spread=0.3), latencies(1.2, 12e-3)),
    "hot_pixels": (NOISY, fx.HotPixels(fraction=0.02, rate_hz=60.0), pixels(10.0, 1.0)),
    "crosstalk": (dataclasses.replace(NOISY, noise_rms=0.09), fx.Crosstalk(probability=0.05), neighbours(1.0)),
    "readout_saturation": (QUIET, fx.ReadoutSaturation(max_rate_eps=2e5), latencies(0.5, 6e-3)),
    "timestamp_jitter": (QUIET, fx.TimestampJitter(sigma_s=5e-4), latencies(0.5, 6e-3)),
    "trail_filter": (SLOW, fx.TrailFilter(), latencies(1.4, 12e-3)),
    "event_rate_limit": (QUIET, fx.EventRateLimit(max_rate_eps=1e5, period_s=2e-3), s_curves(10.0, most=0.6)),
}


def draw(name: str) -> None:
    """Write the figure of an effect."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    base, effect, (x_label, y_label, curves) = FIGURES[name]
    figure, axes = plt.subplots(figsize=(4.2, 2.6), layout="constrained")
    for model, color, label in ((base, "0.6", "without"), (base + effect, "C0", f"with {name}")):
        for i, (x, y) in enumerate(curves(model)):
            axes.plot(x, y, color=color, linestyle=("-", "--")[i % 2], label=label if i == 0 else None)
    axes.set(xlabel=x_label, ylabel=y_label)
    axes.legend(fontsize="small", frameon=False)
    figure.savefig(FOLDER / f"{name}.png", dpi=80, metadata={"Software": None})
    plt.close(figure)


if __name__ == "__main__":
    for chosen in sys.argv[1:] or FIGURES:
        draw(chosen)
