"""Stated dark currents, each with the measurement that it comes from, and the quantum efficiency that each implies.

A step of log contrast C that just reaches the threshold theta on the light E tells the equivalent dark illuminance
``E_d = E (r - e^theta) / (e^theta - 1)``, r = e^C (:mod:`bench.characterize.weber`). A dark current in femtoampere
that is stated beside it holds one number more: ``eta = I / (k_1 E_d)``, k_1 = photons_per_lux q pitch^2. Of one
sensor in one light there is one eta, whatever the threshold was; claims that do not agree on it cannot all be right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Final

from bench.characterize.weber import dark_light
from bench.photometry.csv_tables import half_last_digit, plain_number
from bench.photometry.current import Photodiode
from bench.photometry.propagation import Known
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["Claim", "Pair", "implied", "pairs", "parse_claim"]

_SURE_SIGMA: Final = 2.0
_WANTED: Final = "FA[+-SD],LUX,LOG_CONTRAST,THETA"


@dataclass(frozen=True, slots=True)
class Claim:
    """A stated dark current, and the smallest step that was seen at its threshold."""

    text: str  #: as it was given
    current_fa: float
    sd_fa: float | None  #: its standard error; None where none is stated
    half_digit_fa: float  #: half a unit of the last digit given
    lux: float  #: on the chip, from which the step goes up
    log_contrast: float  #: ln of the step
    theta: float  #: ON threshold, ln


@dataclass(frozen=True, slots=True)
class Implied:
    """What follows from a claim."""

    claim: Claim
    dark_lux: float  #: equivalent dark illuminance, lux
    fa_per_eta: float  #: current that this light makes, fA, at a quantum efficiency of 1
    eta: float  #: the quantum efficiency that the stated current needs
    eta_sd: float | None  #: from the standard error of the current; None where none is stated

    @property
    def margin(self) -> tuple[float, float]:
        """How far eta may be off: two standard errors (0 if none is stated), and rounding (0 if one is)."""
        if self.eta_sd is not None:
            return _SURE_SIGMA * self.eta_sd, 0.0
        return 0.0, self.eta * self.claim.half_digit_fa / self.claim.current_fa


@dataclass(frozen=True, slots=True)
class Pair:
    """Two claims, numbered from 0, held against each other."""

    first: int
    second: int
    difference: float  #: of the two efficiencies, part of their mean
    allowed: float  #: what the stated errors, or rounding, explain; part of their mean

    @property
    def one_eta(self) -> bool:
        """Whether both may follow from one quantum efficiency."""
        return self.difference <= self.allowed


def parse_claim(text: str) -> Claim:
    """Return the claim that a text such as ``5.55+-0.28,0.076,0.8,0.35`` makes.

    The contrast is ln(E_max / E_min), or with ``%`` behind it a linear Weber contrast: ``100%`` is ln(1 + 1).

    Raises
    ------
    InputError
        The text is no claim, or its contrast is not above its threshold.
    """
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 4:
        raise InputError(f"claim {text!r}: expected {_WANTED}, found {len(parts)} of 4 parts")
    current, _, sd = parts[0].replace("\u00b1", "+-").partition("+-")
    has_sd = current != parts[0]
    contrast = _positive(text, "contrast", parts[2].removesuffix("%"))
    claim = Claim(
        text=text,
        current_fa=_positive(text, "current", current),
        sd_fa=_positive(text, "standard error", sd) if has_sd else None,
        half_digit_fa=half_last_digit(current.strip()),
        lux=_positive(text, "lux", parts[1]),
        log_contrast=math.log1p(contrast / 100.0) if parts[2].endswith("%") else contrast,
        theta=_positive(text, "threshold", parts[3]),
    )
    if claim.log_contrast <= claim.theta:
        contrast_text = f"a contrast of {claim.log_contrast:.4g} ln is not above the threshold, {claim.theta:g} ln"
        raise InputError(f"claim {text!r}: {contrast_text}, so no dark light follows from it")
    return claim


def _positive(text: str, name: str, part: str) -> float:
    value = plain_number(part.strip())
    if value is None or not value > 0.0:
        raise InputError(f"claim {text!r}: expected a {name} above 0 ({_WANTED}), found {part.strip()!r}")
    return value


def implied(claim: Claim, pitch_m: float, photons_per_lux: float) -> Implied:
    """Return dark light, current per unit efficiency and the efficiency that a claim implies.

    Parameters
    ----------
    claim
        Its light, contrast and threshold count as exact, its current with its standard error.
    pitch_m
        Distance of two pixels, m.
    photons_per_lux
        Per m2 and s.
    """
    ideal = Photodiode(Known(1.0), Known(pitch_m), Known(photons_per_lux))
    dark = Known(dark_light(claim.log_contrast, claim.lux, claim.theta))
    eta = ideal.efficiency_for(Known(claim.current_fa, claim.sd_fa or 0.0), dark)
    return Implied(
        claim=claim,
        dark_lux=dark.value,
        fa_per_eta=ideal.current(dark).value,
        eta=eta.value,
        eta_sd=None if claim.sd_fa is None else eta.sd,
    )


def pairs(found: Sequence[Implied]) -> list[Pair]:
    """Return each pair of claims, with how far their efficiencies differ, and how far they may."""
    return [_pair(i, j, found[i], found[j]) for i, j in combinations(range(len(found)), 2)]


def _pair(i: int, j: int, a: Implied, b: Implied) -> Pair:
    mean = 0.5 * (a.eta + b.eta)
    (sure_a, rounding_a), (sure_b, rounding_b) = a.margin, b.margin
    # Standard errors are independent; what rounding takes is a bound and not drawn by chance.
    allowed = math.hypot(sure_a, sure_b) + rounding_a + rounding_b
    return Pair(i, j, abs(a.eta - b.eta) / mean, allowed / mean)
