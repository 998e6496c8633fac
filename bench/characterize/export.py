"""The numbers of a sensor for simulators: our own pixel model, and the options of v2e."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.characterize.family_fit import FamilyFit
    from bench.characterize.result import Characterization
    from bench.store.data import Sensor

__all__ = ["model_numbers", "v2e_options"]


def model_numbers(found: Characterization, sensor: Sensor | None) -> dict[str, Any]:
    """Return what a model file holds: the base pixel and the effects that were seen.

    An effect is there where its number differs from none by its 90 % interval; what was not measured is left out, and
    keeps the model's default.
    """
    numbers: dict[str, Any] = {}
    if sensor is not None and math.isfinite(sensor.quantum_efficiency) and math.isfinite(sensor.pixel_pitch_m):
        numbers["photoconversion"] = {
            "eta": sensor.quantum_efficiency, "pitch_m": sensor.pixel_pitch_m,
            "photons_per_lux": sensor.photons_per_lux,
        }  # fmt: skip
    for polarity in ("on", "off"):
        theta = found.theta(polarity)
        if theta is not None and math.isfinite(theta.value):
            numbers[f"theta_{polarity}"] = theta.value
    fit = _best_fit(found)
    if fit is not None:
        numbers["noise_rms"] = fit.family.noise_rms
        numbers["corner_hz"] = 1.0 / (2.0 * math.pi * math.exp(fit.family.ln_tau))
    if math.isfinite(found.refractory_s):
        numbers["refractory_s"] = found.refractory_s
    return numbers | {"effects": dict(_effects(found, fit))}


def _best_fit(found: Characterization) -> FamilyFit | None:
    fits = [f.fit for f in found.families if f.fit is not None]
    return min(fits, key=lambda fit: fit.sd("theta")) if fits else None


def _effects(found: Characterization, fit: FamilyFit | None) -> Iterator[tuple[str, dict[str, float]]]:
    dark = found.dark
    if dark is not None and dark.lux.low > 0.0:
        if dark.current_fa is not None:
            yield "dark_current", {"mean_fa": dark.current_fa.value, "spread": _dark_spread(fit)}
        else:
            yield "stray_light", {"illuminance_lux": dark.lux.value}
    if fit is not None and fit.sees_slow and dark is not None and dark.photodiode is not None:
        hz_per_lux = 1.0 / (2.0 * math.pi * fit.family.slow_s_lux)
        yield "photoreceptor_bandwidth", {"hz_per_fa": hz_per_lux / dark.photodiode.fa_per_lux}
    leaks = [n.leak_per_s for n in found.noise if n.leak_per_s is not None]
    if leaks and min(leaks, key=lambda e: e.high - e.low).low > 0.0:
        yield "leak", {"rate_per_s": min(leaks, key=lambda e: e.high - e.low).value, "spread": 0.0}
    sigmas = {m.polarity: m.sigma.value for m in found.mismatch if m.sigma.low > 0.0}
    if sigmas:
        yield "threshold_mismatch", {f"sigma_{p}": sigma for p, sigma in sigmas.items()}


def _dark_spread(fit: FamilyFit | None) -> float:
    """Return the spread of the dark light over the pixels, where it is seen; else none."""
    if fit is None or fit.family.dark_spread2 < 2.0 * fit.sd("dark_spread2"):
        return 0.0
    return math.sqrt(max(fit.family.dark_spread2, 0.0))


def v2e_options(found: Characterization) -> str:
    """Return options of v2e (Hu, Liu, Delbruck, CVPRW 2021) as a file of arguments, with notes on what they miss."""
    on, off = (found.theta(p) for p in ("on", "off"))
    fit = _best_fit(found)
    lines = [f"# {', '.join(found.runs)}: options for v2e; thresholds and their spread in ln units"]
    lines += [
        f"--pos_thres {on.value:.4f}" if on else "# --pos_thres: no ON curves were taken",
        f"--neg_thres {off.value:.4f}" if off else "# --neg_thres: no OFF curves were taken",
    ]
    sigmas = [m.sigma.value for m in found.mismatch]
    if sigmas:
        lines.append(f"--sigma_thres {sum(sigmas) / len(sigmas):.4f}")
    if fit is not None:
        lines.append(f"--cutoff_hz {1.0 / (2.0 * math.pi * math.exp(fit.family.ln_tau)):.1f}")
    lines += list(_v2e_noise(found))
    if math.isfinite(found.refractory_s):
        lines.append(f"--refractory_period {found.refractory_s:g}")
    return "\n".join([*lines, *_V2E_MISSES]) + "\n"


def _v2e_noise(found: Characterization) -> Iterator[str]:
    if not found.noise:
        yield "# --leak_rate_hz, --shot_noise_rate_hz: no constant light was taken"
        return
    darkest = min(found.noise, key=lambda n: n.baseline_lux)
    brightest = max(found.noise, key=lambda n: n.baseline_lux)
    yield f"--leak_rate_hz {max(brightest.on.value - brightest.off.value, 0.0):.4g}"
    yield f"--shot_noise_rate_hz {darkest.random_hz:.4g}"


_V2E_MISSES = (
    "#",
    "# What v2e cannot express, and its events therefore lack:",
    "# - dark light: its intensities have no unit, so near-dark pixels do not need more contrast;",
    "# - different spreads of the ON and OFF thresholds: sigma_thres is their mean;",
    "# - a photoreceptor whose corner follows the light in Hz per lux: its cutoff follows the frame's brightness;",
    "# - noise at the comparators: shot_noise_rate_hz adds events, it does not broaden response curves;",
    "# - a reference that is memorised after the dead time.",
)
