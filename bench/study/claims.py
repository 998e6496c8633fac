"""What is claimed beside what came out: a number with its interval, and whether it lies within the tolerance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from bench.analysis.results import Estimate
from bench.study.claim_schema import CurveName

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bench.study.claim_schema import Claim, LightStep
    from bench.study.schema import Study
    from bench.study.tasks import Outcome

__all__ = ["Finding", "Verdict", "judge", "number_of", "true_threshold"]

Verdict = Literal["agrees", "does not agree", "too close to tell", "not determined", "not run"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One claim, and what came out."""

    claim: Claim
    measured: Estimate  #: in the unit of the claim, 90 % interval; NaN where it was not run
    verdict: Verdict


def judge(study: Study, outcomes: Mapping[tuple[str, str], Outcome]) -> tuple[Finding, ...]:
    """Return each claim of the study with what came out.

    A claim agrees where the whole 90 % interval lies within the limits, and does not where all of it lies outside.

    Parameters
    ----------
    outcomes
        By variant and stimulus; those that were run.
    """
    pixels = {variant.name: variant.pixel for variant in study.variants}
    found = []
    for claim in study.claims:
        measured = _dark_light_ratio(claim) if claim.steps else _combined(claim, outcomes, pixels)
        found.append(Finding(claim, measured, _verdict(claim, measured)))
    return tuple(found)


def _verdict(claim: Claim, measured: Estimate) -> Verdict:
    low, high = claim.limits
    if not math.isfinite(measured.value):
        return "not run" if measured.note == "not run" else "not determined"
    if low <= measured.low and measured.high <= high:
        return "agrees"
    if measured.high < low or measured.low > high:
        return "does not agree"
    return "too close to tell"


def true_threshold(pixel: Mapping[str, Any], polarity: str) -> float:
    """Return the threshold of one polarity that a pixel was given, ln units."""
    from sim_backend.pixel.model import PixelModel

    model = PixelModel.from_dict(pixel)
    return model.theta_on if polarity == "on" else model.theta_off


def _combined(
    claim: Claim, outcomes: Mapping[tuple[str, str], Outcome], pixels: Mapping[str, Mapping[str, Any]]
) -> Estimate:
    """Return the sum of the numbers less those taken away; intervals of independent numbers add in squares."""
    value = below = above = 0.0
    notes = []
    for sign, names in ((1.0, claim.of), (-1.0, claim.minus)):
        for name in map(CurveName.parse, names):
            outcome = outcomes.get((name.variant, name.stimulus))
            if outcome is None:
                return Estimate(math.nan, math.nan, math.nan, claim.unit, "not run")
            unit = _unit(claim.unit, pixels[name.variant], name.polarity)
            number = number_of(outcome, claim.quantity, name.polarity, pixels[name.variant])
            if not math.isfinite(number.value):
                return Estimate(math.nan, math.nan, math.nan, claim.unit, number.note or "not determined")
            value += sign * number.value / unit
            down, up = (number.value - number.low) / unit, (number.high - number.value) / unit
            below += (down if sign > 0 else up) ** 2
            above += (up if sign > 0 else down) ** 2
            notes.append(number.note)
    note = "; ".join(filter(None, notes))
    return Estimate(value, value - math.sqrt(below), value + math.sqrt(above), claim.unit, note)


def _unit(unit: str, pixel: Mapping[str, Any], polarity: str) -> float:
    if unit == "threshold":
        return true_threshold(pixel, polarity)
    if unit == "less_sensitive":
        return max(true_threshold(pixel, "on"), true_threshold(pixel, "off"))
    return 1.0


def number_of(outcome: Outcome, quantity: str, polarity: str, pixel: Mapping[str, Any]) -> Estimate:
    """Return one number that was read off an outcome; NaN where the data do not determine it."""
    if quantity == "rate":
        return _rate(outcome, polarity)
    if quantity == "reset_over_threshold":
        ratio = outcome.reset_ln / true_threshold(pixel, polarity)
        return Estimate(ratio, ratio, ratio, "1")
    curve = outcome.curve(polarity)
    found: Estimate | None = getattr(curve, quantity) if curve is not None else None
    if found is None:
        left_out = quantity == "theta" and not outcome.fitted
        return Estimate(math.nan, math.nan, math.nan, "ln", "not run" if left_out else "not determined")
    return found


def _rate(outcome: Outcome, polarity: str) -> Estimate:
    """Return the mean rate over all recordings; ON and OFF are not independent, so their intervals simply add."""
    rows = [row for row in outcome.background if polarity in ("both", row.polarity)]
    recordings = {row.point for row in rows}
    if not recordings:
        return Estimate(math.nan, math.nan, math.nan, "Hz", "not run")
    value = sum(row.rate.value for row in rows) / len(recordings)
    half = [sum(0.5 * (r.rate.high - r.rate.low) for r in rows if r.point == point) for point in recordings]
    reach = math.sqrt(sum(h * h for h in half)) / len(recordings)
    return Estimate(value, value - reach, value + reach, "Hz")


def _dark_light_ratio(claim: Claim) -> Estimate:
    ratio = _dark_light_lux(claim.steps[0]) / _dark_light_lux(claim.steps[1])
    return Estimate(ratio, ratio, ratio, "1", "a calculation: no interval")


def _dark_light_lux(step: LightStep) -> float:
    """Return ``E_d = E (r - e^theta) / (e^theta - 1)``, r the ratio of the light (the paper's eq. on_event)."""
    return step.lux * (math.exp(step.log_contrast) - math.exp(step.theta)) / math.expm1(step.theta)
