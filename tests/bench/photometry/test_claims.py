"""Stated dark currents and the quantum efficiency that they imply."""

from __future__ import annotations

import math
import re

import pytest

from bench.photometry.claims import Implied, implied, pairs, parse_claim
from protocols.errors import InputError

PITCH_M = 4.86e-6
PHOTONS = 1.12e16
FA_PER_LUX = PHOTONS * 1.602176634e-4 * PITCH_M**2


def follow(*claims: str) -> list[Implied]:
    return [implied(parse_claim(claim), PITCH_M, PHOTONS) for claim in claims]


def exact(eta: float, lux: float, contrast: float, theta: float, digits: int = 6) -> str:
    """Return a claim that follows from an efficiency, rounded."""
    dark_lux = lux * (math.exp(contrast) - math.exp(theta)) / math.expm1(theta)
    return f"{eta * FA_PER_LUX * dark_lux:.{digits}g},{lux},{contrast},{theta}"


def test_two_published_claims_do_not_follow_from_one_eta() -> None:
    first, second = follow("5.55+-0.28,0.076,0.8,0.35", "5.62,0.080,100%,0.25")
    assert [first.dark_lux, second.dark_lux] == pytest.approx([0.1463, 0.2017], abs=5e-5)
    assert [first.fa_per_eta, second.fa_per_eta] == pytest.approx([6.199, 8.547], abs=5e-4)
    assert [first.eta, second.eta] == pytest.approx([0.895, 0.658], abs=6e-4)
    assert first.eta_sd == pytest.approx(0.895 * 0.28 / 5.55, abs=5e-5)
    assert second.eta_sd is None
    (pair,) = pairs([first, second])
    assert pair.difference == pytest.approx(0.306, abs=5e-4)
    assert not pair.one_eta


def test_claims_of_one_sensor_agree_within_their_rounding() -> None:
    found = follow(exact(0.6, 0.076, 0.8, 0.35, 3), exact(0.6, 0.08, 0.7, 0.25, 3))
    assert [one.eta for one in found] == pytest.approx([0.6, 0.6], rel=5e-3)
    (pair,) = pairs(found)
    assert pair.one_eta
    assert pair.allowed < 0.01


@pytest.mark.parametrize(
    ("first", "second", "one_eta"),
    [
        (exact(0.6, 0.076, 0.8, 0.35), exact(0.61, 0.08, 0.7, 0.25), False),  # 1.7 % apart, written with six digits
        (exact(0.6, 0.076, 0.8, 0.35, 1), exact(0.61, 0.08, 0.7, 0.25, 1), True),  # and with one
        ("4.0+-0.2,0.1,0.7,0.3", "4.5+-0.2,0.1,0.7,0.3", True),  # 0.5 apart, two standard errors are 0.57
        ("4.0+-0.2,0.1,0.7,0.3", "4.6+-0.2,0.1,0.7,0.3", False),
    ],
)
def test_pairs_are_judged_by_what_is_stated(first: str, second: str, one_eta: bool) -> None:
    (pair,) = pairs(follow(first, second))
    assert pair.one_eta is one_eta


def test_three_claims_are_three_pairs() -> None:
    found = pairs(follow(*["4.0,0.1,0.7,0.3"] * 3))
    assert [(pair.first, pair.second) for pair in found] == [(0, 1), (0, 2), (1, 2)]
    assert all(pair.difference == 0.0 for pair in found)


def test_an_efficiency_above_one_is_kept_for_the_reader() -> None:
    assert follow("20,0.076,0.8,0.35")[0].eta > 1.0


def test_the_ways_to_write_a_claim() -> None:
    assert parse_claim("5.55 \u00b1 0.28, 0.076, 0.8, 0.35").sd_fa == 0.28
    assert parse_claim("5.62,0.080,100%,0.25").log_contrast == pytest.approx(math.log(2.0))
    assert parse_claim("5.6,0.080,0.9,0.25").half_digit_fa == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("5.55", "claim '5.55': expected FA[+-SD],LUX,LOG_CONTRAST,THETA, found 1 of 4 parts"),
        ("5.55,1,2,3,4", "found 5 of 4 parts"),
        ("x,0.076,0.8,0.35", "expected a current above 0 (FA[+-SD],LUX,LOG_CONTRAST,THETA), found 'x'"),
        ("5.55+-,0.076,0.8,0.35", "expected a standard error above 0"),
        ("5.55+-0,0.076,0.8,0.35", "expected a standard error above 0"),
        ("5.55,0,0.8,0.35", "expected a lux above 0"),
        ("5.55,0.076,nan,0.35", "expected a contrast above 0"),
        ("5.55,0.076,0.8,-1", "expected a threshold above 0"),
        ("5.55,0.076,0.3,0.35", "a contrast of 0.3 ln is not above the threshold, 0.35 ln"),
        ("5.55,0.076,40%,0.35", "a contrast of 0.3365 ln is not above the threshold, 0.35 ln"),
    ],
)
def test_what_is_no_claim_is_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        parse_claim(text)
