"""One family of S-curves, from its curves to numbers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.results import Estimate
from bench.characterize.families import fit, readings_of
from bench.characterize.normal import as_estimate, as_known
from bench.characterize.readings import line_through, of_level
from bench.characterize.result import Constancy, FamilyResult, FilterBreak, LevelResult

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from bench.characterize.families import CurveFamily
    from bench.characterize.family_fit import FamilyFit
    from bench.characterize.readings import Line, Uncertainties
    from bench.store.data import PointData

__all__ = ["family_result"]

_POOR: Final = 1.5  # chi-square per degree of freedom above which a fit is said to be poor
_UNKNOWN: Final = Estimate(math.nan, math.nan, math.nan, "lux")


def family_result(
    family: CurveFamily, points: Sequence[PointData], run: str, beside: Uncertainties,
    other_ratio: float | None = None,
) -> FamilyResult:  # fmt: skip
    """Read dark light and threshold off the curves, and fit one sensor to all of them.

    Parameters
    ----------
    points
        All points of the run.
    other_ratio
        Threshold of the other polarity, divided by that of this one; None where nothing is known of it.
    """
    by_intercept = line_through(readings_of(family, "intercept"), family.polarity)
    by_half = line_through(readings_of(family, "half"), family.polarity)
    found, why = fit(family, points, beside, other_ratio)
    best = found.estimate("theta", "ln") if found else _of(by_intercept or by_half, "theta", "ln")
    dark = found.estimate("dark_lux", "lux") if found else _of(by_intercept or by_half, "dark_lux", "lux")
    biased = (
        by_intercept.dark_lux.value / dark.value - 1.0 if found and by_intercept and dark.value > 0.0 else math.nan
    )
    return FamilyResult(
        run=run,
        polarity=family.polarity,
        waveform=family.waveform,
        pulse_width_s=family.pulse_width_s,
        settings=family.settings,
        levels=tuple(_levels(family, by_intercept or by_half, found, beside)),
        by_intercept=by_intercept,
        by_half=by_half,
        fit=found,
        why_no_fit=why,
        constant=_constancy(found, by_intercept),
        filter_break=FilterBreak(found.estimate("filter_od", "OD")) if found and "filter_od" in found.free else None,
        theta=best,
        dark_lux=dark,
        biased=biased,
        warnings=tuple(_warnings(family, found, points)),
    )


def _of(line: Line | None, name: str, unit: str) -> Estimate:
    if line is None:
        return Estimate(math.nan, math.nan, math.nan, unit, "fewer than two levels have a reading")
    return Estimate(getattr(line, name).value, getattr(line, name).low, getattr(line, name).high, unit)


def _levels(
    family: CurveFamily, line: Line | None, found: FamilyFit | None, beside: Uncertainties
) -> Iterator[LevelResult]:
    for i, (curve, reading) in enumerate(zip(family.curves, readings_of(family, "intercept"), strict=True)):
        dark, parts = _UNKNOWN, {}
        if line is not None and math.isfinite(reading.contrast.value):
            own = of_level(reading, as_known(line.theta), family.polarity, beside)
            dark = as_estimate(own.value, own.sd, "lux")
            parts = own.parts
        noise, corner = (math.nan, math.nan) if found is None else found.at(curve.key.baseline_lux, curve.key.nd_od)
        yield LevelResult(
            curve.key.baseline_lux, curve.key.nd_od, curve.half, curve.intercept,
            found.level_theta[i] if found else None, dark, parts, noise, corner,
        )  # fmt: skip


def _constancy(found: FamilyFit | None, line: Line | None) -> Constancy | None:
    """Return the test of one threshold for all levels: of the fit, else of the straight line."""
    from scipy.special import chdtrc

    if found is not None and found.constant[1] > 0:
        chi2, dof = found.constant
        off = [e.value - found.family.theta for e in found.level_theta if math.isfinite(e.value)]
        largest = max(off, key=abs, default=math.nan)
        return Constancy(chi2, dof, float(chdtrc(dof, chi2)), float(largest))
    if line is not None and line.dof > 0:
        return Constancy(line.chi2, line.dof, float(chdtrc(line.dof, line.chi2)), math.nan)
    return None


def _warnings(
    family: CurveFamily, found: FamilyFit | None, points: Sequence[PointData]
) -> Iterator[str]:  # fmt: skip
    if found is None:
        return
    if found.chi2 > _POOR * found.dof:
        yield (
            f"the fit is poor (chi-square {found.chi2:.0f} for {found.dof} degrees of freedom) and its intervals are "
            "widened by it: something else is at work; `evs-bench diagnose` tells what"
        )
    slowest = min((found.at(c.key.baseline_lux, c.key.nd_od)[1] for c in family.curves), default=np.inf)
    taken = {row.point for row in family.rows}
    dead_time_known = all(math.isfinite(p.refractory_s) for p in points if p.index in taken)
    if math.isfinite(slowest) and found.sees_slow and not dead_time_known:
        yield (
            f"at the dimmest level the photoreceptor has a corner of {slowest:.3g} Hz: with a dead time that is not "
            f"several times its {1e3 / (2 * math.pi * slowest):.3g} ms a pixel memorises its reference before the "
            "light of the reset pulse is gone; the dead time was not recorded, so the fit does not allow for it"
        )
