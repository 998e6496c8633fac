"""The families of S-curves of a run: one for each polarity, setting and pulse width, of two levels or more."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from bench.analysis.noisy_pixel import guess
from bench.analysis.results import Estimate
from bench.characterize.family_fit import NAMES, fit_family
from bench.characterize.family_model import Family
from bench.characterize.family_problem import Known
from bench.characterize.levels import levels_of
from bench.characterize.readings import Reading, line_through

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.analysis.results import Analysis, CurveKey, ResponsePolarity, ResponseRow, SCurve
    from bench.characterize.family_fit import FamilyFit
    from bench.characterize.levels import Level
    from bench.characterize.readings import Line, Uncertainties
    from bench.store.data import PointData

__all__ = ["CurveFamily", "families_in", "fit", "readings_of"]

_OTHER_RATIO: Final = 0.9  # threshold of the other polarity / that of this one, where nothing is known of it
_SLOW: Final = 0.5  # of the low-pass's time constant: a photoreceptor that may matter
_MISMATCH: Final = 0.3  # of the noise, where a fit starts
_NOT_ITS_OWN: Final = Estimate(math.nan, math.nan, math.nan, "ln", "a square wave shows the larger threshold alone")
_FEWEST_CONTRASTS: Final = 4
_LEAST_PIXELS: Final = 16
_LEAST_RISING: Final = 2  # contrasts on the rise of each curve
_LEAST_RISING_IN_ALL: Final = 6
_RISE: Final = (0.02, 0.98)  # of the highest share


@dataclass(frozen=True, slots=True)
class CurveFamily:
    """S-curves that differ in their light level alone."""

    polarity: ResponsePolarity
    waveform: str
    pulse_width_s: float
    settings: str
    curves: tuple[SCurve, ...]  #: from the dimmest level on
    rows: tuple[ResponseRow, ...]

    @property
    def levels(self) -> int:
        """Number of light levels."""
        return len({c.key.baseline_lux for c in self.curves})


def families_in(analysis: Analysis) -> list[CurveFamily]:
    """Return the families of a run; curves of a level that is the only one of its kind are left out."""
    groups: dict[tuple[str, str, float, str], list[SCurve]] = {}
    for curve in analysis.curves:
        if curve.log_contrast.size < _FEWEST_CONTRASTS:
            continue  # a step of one contrast at many levels is no curve
        groups.setdefault(_kind(curve.key), []).append(curve)
    found = []
    for kind, curves in groups.items():
        curves.sort(key=lambda c: (c.key.baseline_lux, -c.key.nd_od))
        keys = {c.key for c in curves}
        rows = tuple(r for r in analysis.responses if r.key in keys)
        found.append(CurveFamily(curves[0].key.polarity, *kind[1:], tuple(curves), rows))
    return [family for family in found if family.levels > 1]


def _kind(key: CurveKey) -> tuple[str, str, float, str]:
    return key.polarity, key.waveform, key.pulse_width_s, key.settings


def readings_of(family: CurveFamily, reading: str) -> list[Reading]:
    """Return the readings of all curves: `half` or `intercept`.

    Unknown where a square wave shows the other polarity's threshold: it needs the contrast of that one.
    """
    return [
        Reading(c.key.baseline_lux, c.key.nd_od, getattr(c, reading) if c.limited_by is None else _NOT_ITS_OWN)
        for c in family.curves
    ]


def fit(
    family: CurveFamily, points: Sequence[PointData], beside: Uncertainties, other_ratio: float | None = None
) -> tuple[FamilyFit | None, str]:  # fmt: skip
    """Fit one sensor to a family; return None, and why, where the data do not allow it.

    Parameters
    ----------
    points
        All points of the run; they tell what comes before a step.
    other_ratio
        Threshold of the other polarity, divided by that of this one; None where nothing is known of it.
    """
    reason = _reason_against(family)
    if reason:
        return None, reason
    levels = levels_of(family.rows, points)
    line = line_through(readings_of(family, "half"), family.polarity)
    if line is None:
        return None, "fewer than two levels have a 50 % point"
    free = _free(levels, beside)
    known = Known(other_ratio or _OTHER_RATIO, _filter_sd(beside))
    return fit_family(levels, known, _start(family, levels, line), free), ""


def _reason_against(family: CurveFamily) -> str:
    """Return why the family cannot be fitted, as text; empty if it can be."""
    if family.waveform != "reset_test":
        return "only reset and test pulses leave a reference that does not depend on the contrast"
    pixels = {r.per_pixel.size for r in family.rows}
    if not pixels:
        return "curves without pixels"
    if len(pixels) > 1:
        return "the points have different numbers of pixels"
    if max(pixels) < _LEAST_PIXELS:
        return f"{max(pixels)} pixels; at least {_LEAST_PIXELS} are needed"
    rising = [_rising([r.probability for r in family.rows if r.key == c.key]) for c in family.curves]
    if min(rising) < _LEAST_RISING or sum(rising) < _LEAST_RISING_IN_ALL:
        return (
            f"{min(rising)} contrasts on the rise of a curve, {sum(rising)} in all; at least {_LEAST_RISING} and "
            f"{_LEAST_RISING_IN_ALL} are needed"
        )
    bright = [r for r in family.rows if r.key == family.curves[-1].key]
    if not any(r.responses for r in bright):
        return "no pulse in bright light was answered"
    if not any(r.latency_counts.sum() for r in bright):
        return "there are no latencies, for want of triggers"
    return ""


def _rising(shares: Sequence[float]) -> int:
    top = max(shares)
    return sum(_RISE[0] * top < share < _RISE[1] * top for share in shares)


def _free(levels: Sequence[Level], beside: Uncertainties) -> tuple[str, ...]:
    """Return the numbers to fit: a filter's density where it is not exact, and levels with and without it tell it."""
    behind = {level.key.nd_od > 0.0 for level in levels}
    open_filter = len(behind) == 2 and beside.nd_od != 0.0
    return tuple(name for name in NAMES if name != "filter_od" or open_filter)


def _filter_sd(beside: Uncertainties) -> float:
    return math.inf if beside.nd_od is None else max(beside.nd_od, 1e-9)


def _start(family: CurveFamily, levels: Sequence[Level], line: Line) -> Family:
    """Return where to start: with a fast photoreceptor, or if the dim answers come late with a slow one."""
    brightest = family.curves[-1].key
    pixels, tau_s = guess(sorted((r for r in family.rows if r.key == brightest), key=lambda r: r.log_contrast))
    mismatch2 = (_MISMATCH * pixels.noise_rms) ** 2
    dark = max(line.dark_lux.value, 0.01 * levels[0].key.baseline_lux)
    slow_s_lux = 0.0
    dim, bright = levels[0], levels[-1]
    if dim.latency_s.size and bright.latency_s.size:
        later_s = float(dim.latency_s.mean() - bright.latency_s.mean())
        if later_s > _SLOW * tau_s:
            dark = 0.5 * dark  # what is slow looks dark
            slow_s_lux = later_s * (dim.key.baseline_lux + dark)
    return Family(
        theta=pixels.theta, noise_rms=pixels.noise_rms, mismatch2=mismatch2, ln_tau=math.log(tau_s), delay_s=0.0,
        dark_lux=dark, dark_spread2=0.0, shot_lux=0.0, slow_s_lux=slow_s_lux, filter_od=0.0,
    )  # fmt: skip
