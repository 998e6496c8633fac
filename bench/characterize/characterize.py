"""From runs to the numbers of a sensor."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bench.analysis.whole import analyze
from bench.characterize.cutoff import cutoffs_in
from bench.characterize.families import families_in
from bench.characterize.family_result import family_result
from bench.characterize.mismatch import mismatch_of
from bench.characterize.noise import PixelKnown, hot_pixels_in, noise_levels
from bench.characterize.normal import as_estimate, as_known
from bench.characterize.readings import line_through, with_recorded
from bench.characterize.result import Characterization, DarkLight
from bench.photometry.current import Photodiode
from bench.photometry.propagation import Known

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from bench.analysis.results import Analysis, ResponsePolarity
    from bench.analysis.whole import RunLike
    from bench.characterize.families import CurveFamily
    from bench.characterize.readings import Uncertainties
    from bench.characterize.result import Cutoff, FamilyResult, NoiseLevel
    from bench.store.data import PointData, Sensor

__all__ = ["characterize", "characterize_curves"]


def characterize(
    runs: Sequence[RunLike], beside: Uncertainties, tell: Callable[[str], None] | None = None
) -> Characterization:
    """Turn runs of one sensor into its numbers: threshold, dark light, noise, bandwidth, mismatch.

    Parameters
    ----------
    runs
        Families of S-curves, and whatever else there is: background activity, other pulse widths, a low-light cutoff.
    beside
        Standard errors of what stands on dials; those that are not given are taken from the points, if they tell.
    tell
        Called with what is being done.

    Raises
    ------
    RunError
        A file of a run is damaged.
    """
    say = tell or (lambda _: None)
    families: list[FamilyResult] = []
    analyses: list[Analysis] = []
    points: list[list[PointData]] = []
    for run in runs:
        say(f"reading {run.header.id}")
        points.append(list(run.points()))
    beside = with_recorded(beside, [p for own in points for p in own])
    for run, own in zip(runs, points, strict=True):
        analyses.append(analyze(run, theta_fit=lambda _: None))
        say(f"fitting the families of {run.header.id}")
        families += _families(analyses[-1], own, beside)
    dark = _dark_light(families, runs[0].header.sensor, beside)
    maps = {analysis.run_id: analysis.pixel_maps for analysis in analyses}
    best = [f for f in (_best(families, "on"), _best(families, "off")) if f is not None]
    return Characterization(
        runs=tuple(run.header.id for run in runs),
        families=tuple(families),
        dark=dark,
        cutoffs=tuple(_cutoffs(analyses, families, dark)),
        noise=tuple(_noise(analyses, _known_pixels(families, _refractory_s(points)))),
        mismatch=tuple(m for f in best if (m := mismatch_of(f, maps[f.run])) is not None),
        hot_pixels=tuple(spot for own in points for spot in hot_pixels_in(own)),
        refractory_s=_refractory_s(points),
        beside=beside,
        warnings=tuple(_warnings(families, points, analyses)),
    )


def characterize_curves(
    name: str, families: Sequence[CurveFamily], beside: Uncertainties, sensor: Sensor | None = None
) -> Characterization:
    """Turn curves that were measured elsewhere into what they tell: threshold and dark light.

    Parameters
    ----------
    name
        Where they are from.
    sensor
        For the dark current; None leaves it out.
    """
    found = [family_result(family, (), name, beside) for family in families]
    dark = _dark_light(found, sensor, beside)
    return Characterization(
        runs=(name,), families=tuple(found), dark=dark, cutoffs=(), noise=(), mismatch=(), hot_pixels=(),
        refractory_s=math.nan, beside=beside, warnings=tuple(w for f in found for w in f.warnings),
    )  # fmt: skip


def _families(analysis: Analysis, points: Sequence[PointData], beside: Uncertainties) -> Iterator[FamilyResult]:
    found = families_in(analysis)
    for family in found:
        yield family_result(family, points, analysis.run_id, beside, _other_ratio(family, found))


def _other_ratio(family: CurveFamily, families: Sequence[CurveFamily]) -> float | None:
    """Return the threshold of the other polarity beside that of this one, from their bright curves."""
    for other in families:
        alike = (other.waveform, other.pulse_width_s, other.settings)
        if other.polarity != family.polarity and alike == (family.waveform, family.pulse_width_s, family.settings):
            ratio = other.curves[-1].half.value / family.curves[-1].half.value
            return ratio if math.isfinite(ratio) else None
    return None


def _best(
    families: Sequence[FamilyResult], polarity: ResponsePolarity, settings: str | None = None
) -> FamilyResult | None:
    """Return the family that knows its threshold best; at one setting, or at any."""
    mine = [f for f in families if f.polarity == polarity and math.isfinite(f.theta.value)]
    mine = [f for f in mine if settings is None or f.settings == settings]
    return min(mine, key=lambda f: f.theta.high - f.theta.low) if mine else None


def _dark_light(families: Sequence[FamilyResult], sensor: Sensor | None, beside: Uncertainties) -> DarkLight | None:
    """Return the mean of all families that tell dark light, weighted by what chance leaves them, with its errors."""
    good = [f for f in families if math.isfinite(f.dark_lux.value) and f.dark_lux.high > f.dark_lux.low]
    if any(f.fit is not None for f in good):
        good = [f for f in good if f.fit is not None]
    if not good:
        return None
    value = np.array([f.dark_lux.value for f in good])
    sd = np.array([as_known(f.dark_lux).sd for f in good])
    weight = sd**-2 / np.sum(sd**-2)
    mean = float(weight @ value)
    scatter = float(np.sum(((value - mean) / sd) ** 2)) / (len(good) - 1) if len(good) > 1 else math.nan
    chance = math.sqrt(1.0 / float(np.sum(sd**-2))) * math.sqrt(max(1.0, scatter) if len(good) > 1 else 1.0)
    parts = {
        "chance": chance,
        "illuminance": (beside.light or 0.0) * abs(mean),
        "contrast": _by_contrast(good[0], beside),
    }
    # Families whose filters were not fitted along take them as they are said to be.
    taken = [w for w, f in zip(weight, good, strict=True) if not f.filter_break and any(lv.nd_od for lv in f.levels)]
    if beside.nd_od and taken:
        parts["filter"] = math.log(10.0) * beside.nd_od * abs(mean) * float(sum(taken))
    total = math.hypot(*parts.values())
    lux = as_estimate(mean, total, "lux")
    photodiode = None if sensor is None else Photodiode.of(sensor, beside.eta)
    if photodiode is None:
        return DarkLight(lux, parts, None, {}, None, scatter)
    current = photodiode.current(Known(mean, total))
    fa = as_estimate(current.value, current.sd, "fA")
    return DarkLight(lux, parts, fa, current.parts, photodiode, scatter)


def _by_contrast(family: FamilyResult, beside: Uncertainties) -> float:
    """Return how far the dark light moves when all contrasts are wrong by their standard error, lux."""
    if not beside.contrast:
        return 0.0
    from bench.characterize.readings import Reading

    there = []
    for shift in (0.0, beside.contrast):
        readings = [
            Reading(lv.baseline_lux, lv.nd_od, replace(lv.half, value=lv.half.value + shift)) for lv in family.levels
        ]
        line = line_through(readings, family.polarity)
        there.append(line.dark_lux.value if line else math.nan)
    return abs(there[1] - there[0])


def _known_pixels(families: Sequence[FamilyResult], refractory_s: float) -> dict[str, PixelKnown]:
    """Return thresholds, corner and dead time at each setting at which a family was fitted."""
    found = {}
    for settings in dict.fromkeys(f.settings for f in families):
        on, off = (_best(families, p, settings) for p in ("on", "off"))
        fits = [f.fit for f in (on, off) if f is not None and f.fit is not None]
        if fits:
            surest = min(fits, key=lambda fit: fit.sd("ln_tau"))
            corner = 1.0 / (2.0 * math.pi * math.exp(surest.family.ln_tau))
            theta_on, theta_off = (f.theta.value if f is not None else math.nan for f in (on, off))
            found[settings] = PixelKnown(theta_on, theta_off, corner, refractory_s)
    return found


def _refractory_s(points: Sequence[Sequence[PointData]]) -> float:
    """Return the dead time of the settings; NaN where it is not known, or differs."""
    known = {p.refractory_s for own in points for p in own if math.isfinite(p.refractory_s)}
    return known.pop() if len(known) == 1 else math.nan


def _cutoffs(
    analyses: Sequence[Analysis], families: Sequence[FamilyResult], dark: DarkLight | None
) -> Iterator[Cutoff]:
    half: dict[tuple[ResponsePolarity, str], Known] = {}
    theta: dict[tuple[ResponsePolarity, str], Known] = {}
    for family in families:
        best = _best(families, family.polarity, family.settings)
        if best is not None:
            theta[family.polarity, family.settings] = as_known(best.theta)
        if best is not None and best.by_half is not None:
            half[family.polarity, family.settings] = as_known(best.by_half.theta)
    lux = None if dark is None else as_known(dark.lux)
    for analysis in analyses:
        yield from cutoffs_in(analysis.responses, half, theta, lux)


def _noise(analyses: Sequence[Analysis], pixels: Mapping[str, PixelKnown]) -> Iterator[NoiseLevel]:
    for analysis in analyses:
        yield from noise_levels(analysis.background, pixels)


def _warnings(
    families: Sequence[FamilyResult], points: Sequence[Sequence[PointData]], analyses: Sequence[Analysis]
) -> Iterator[str]:
    yield from (text for analysis in analyses for text in analysis.warnings)
    if not families:
        yield "no family of S-curves: at least two light levels at the same settings and pulse width are needed"
    if not any(p.waveform == "constant" for own in points for p in own):
        yield "no constant light was taken: nothing can be said of background activity; see background_activity"
    yield from dict.fromkeys(text for family in families for text in family.warnings)
