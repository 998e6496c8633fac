"""What finished cases say together, of cases that were written by hand."""

from __future__ import annotations

import math

import pytest

from benchmarks.planted.numbers import Claim, Tried, claims, falls
from benchmarks.planted.score import Score, Share


def case(
    *planted: str,
    kind: str = "single",
    errors: tuple[float, ...] = (40.0, 1.0),
    unseen: tuple[float, ...] | None = None,
    coverage: dict[str, bool] | None = None,
    seconds: float = 10.0,
) -> Tried:
    """Return a case in which all that was planted was named."""
    return Tried(
        name="case", kind=kind, planted=planted, size=dict.fromkeys(planted, 20.0), beyond_mimic=None,
        reference=False, truth_leaves=None, seconds=seconds,
        score=Score(
            verdict="explained", groups=tuple((e,) for e in planted), first_right=True, all_named=True, false=0,
            coverage=coverage or {}, errors=errors, unseen=errors if unseen is None else unseen, floor=1.0,
        ),
    )  # fmt: skip


def found(cases: list[Tried], text: str) -> Claim:
    (claim,) = (c for c in claims(cases) if text in c.text)
    return claim


@pytest.mark.parametrize(
    ("share", "bounds", "asked", "met"),
    [
        (Share(19, 20), (0.95, 1.0), "95 % or more", True),
        (Share(94, 100), (0.95, 1.0), "95 % or more", False),  # 95 % lies in its interval all the same
        (Share(20, 20), (1.0, 1.0), "all", True),
        (Share(199, 200), (1.0, 1.0), "all", False),
        (Share(80, 100), (0.80, 0.97), "80 to 97 %", True),
        (Share(98, 100), (0.80, 0.97), "80 to 97 %", False),
        (Share(0, 0), (0.95, 1.0), "95 % or more", None),
        (Share(1, 20), (None, 1.0), "", None),
    ],
)
def test_what_was_asked_is_met_by_the_share(
    share: Share, bounds: tuple[float | None, float], asked: str, met: bool | None
) -> None:
    claim = Claim("something", share, *bounds)
    assert (claim.asked, claim.met) == (asked, met)


def test_intervals_of_effects_are_told_apart_from_those_of_the_base_pixel() -> None:
    cases = [
        case("leak", coverage={"leak.rate_per_s": False, "thresholds.on": True, "noise_floor.rms": True}),
        case("leak", coverage={"leak.rate_per_s": True, "thresholds.on": False}),
        case("hot_pixels", coverage={"hot_pixels.rate_hz@second": False}),
    ]
    every, effects, base = (
        found(cases, t) for t in ("all numbers", "numbers of effects", "numbers of the base pixel")
    )
    assert (every.found, effects.found, base.found) == (Share(3, 6), Share(1, 3), Share(2, 3))
    assert (every.asked, effects.asked, base.asked) == ("80 to 97 %", "", "")


def test_diagnoses_of_half_a_minute_are_counted() -> None:
    claim = found([case("leak", seconds=s) for s in (12.0, 30.0, 30.1, 400.0)], "30 s or less")
    assert (claim.found, claim.met) == (Share(2, 4), None)


def test_the_fall_of_the_error_has_quartiles_for_each_kind() -> None:
    cases = [case("leak", errors=(float(e), 5.0, 1.0), unseen=(2.0 * e, 5.0, 1.5)) for e in range(1, 6)]
    cases += [case("leak", errors=(1.0,)), case("leak", kind="outside"), case(kind="none", errors=(1.0,))]
    (single,) = falls(cases)
    assert (single.kind, single.count) == ("single", 5)
    assert (single.before, single.after) == ((2.0, 3.0, 4.0), (1.0, 1.0, 1.0))
    assert (single.unseen_before, single.unseen_after) == ((4.0, 6.0, 8.0), (1.5, 1.5, 1.5))


def test_errors_that_are_not_known_are_left_out_of_the_quartiles() -> None:
    known, unknown = case("leak"), case("leak", unseen=(math.nan, math.nan))
    (one,) = falls([known, unknown])
    assert (one.count, one.unseen_before) == (2, (40.0, 40.0, 40.0))
    (none,) = falls([unknown])
    assert all(math.isnan(q) for q in none.unseen_after)
