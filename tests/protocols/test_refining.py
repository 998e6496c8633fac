"""Points that may be added to curves: their numbers, their seeds, the worst case, and what is wrong in a file."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocols import InputError, parse_protocol
from protocols.estimation import estimate
from protocols.json_schema import protocol_json_schema
from protocols.schema import Protocol

if TYPE_CHECKING:
    from protocols.points import Point

REFINE = "refine: {until: {gap: 0.05}, at_most: 4}"
TEXT = """\
format: evs-bench-protocol/1
title: refined
seed: 3
roi: {x: 0, y: 0, width: 4, height: 4}
expect: {theta_on: 0.3, theta_off: 0.25, dark_light_lux: 0.1}
pulses: 10
order: ORDER
measurements:
  - name: family
    stimulus: {kind: reset_test, reset_s: 0.1, test_s: 0.1, gap_s: 0.1, reset_contrast: {scale: log, value: 0.8}}
    sweep:
      illuminance_lux: [0.5, 10]
      polarity: ["on", "off"]
      nd_od: {od: 2, below_lux: 1}
      contrast:
        scale: threshold
        linspace: {start: 0.3, stop: 1.5, num: 5}
        REFINE
  - name: dark
    stimulus: {kind: constant, duration_s: 2}
    sweep: {illuminance_lux: [0.5], nd_od: [2]}
  - name: plain
    stimulus: {kind: square, frequency_hz: 5}
    sweep: {illuminance_lux: 10, contrast: {scale: log, values: [0.5, 1]}}
"""


def made(refine: str = REFINE, order: str = "as_written") -> Protocol:
    return parse_protocol(TEXT.replace("REFINE", refine).replace("ORDER", order), "refined.yaml").protocol


def curve_of(point: Point) -> tuple[object, ...]:
    return point.measurement, point.baseline_lux, point.polarity


@pytest.mark.parametrize("order", ["as_written", "shuffled"])
def test_what_is_planned_stays_as_it_is_without_the_key(order: str) -> None:
    assert made(order=order).expand() == made("", order).expand()


def test_nothing_may_be_added_without_the_key() -> None:
    protocol = made("")
    assert protocol.refined_curves() == ()
    assert protocol.worst_case() == protocol.expand()
    assert protocol.estimate() == estimate(protocol.expand())
    assert protocol.resolved()["measurements"][0]["sweep"]["contrast"].keys() == {"scale", "values"}


@pytest.mark.parametrize("order", ["as_written", "shuffled"])
def test_each_curve_has_numbers_and_seeds_of_its_own_behind_all_planned_points(order: str) -> None:
    protocol = made(order=order)
    planned, curves = protocol.expand(), protocol.refined_curves()
    assert len(curves) == 4
    spare = [point for curve in curves for point in curve.spare]
    assert [point.index for point in spare] == list(range(len(planned), len(planned) + 16))
    assert len({point.seed for point in (*planned, *spare)}) == len(planned) + 16
    for curve in curves:
        assert len(curve.planned) == 5
        assert curve.number == curve.spare[0].index
        assert {curve_of(point) for point in curve.planned} == {curve_of(point) for point in curve.spare}
        places = [planned.index(point) for point in curve.planned]
        assert places == list(range(places[0], places[0] + 5))  # so that nothing is moved for what is added


def test_a_spare_point_is_like_its_curve_but_for_contrast_number_and_seed() -> None:
    for curve in made().refined_curves():
        for point in curve.spare:
            first = curve.planned[0]
            same = replace(point, index=first.index, seed=first.seed, log_contrast=first.log_contrast)
            assert same == first


def test_an_operator_is_asked_once() -> None:
    text = TEXT.replace("  - name: family\n", "  - name: family\n    operator: {before: look}\n")
    protocol = parse_protocol(text.replace("REFINE", REFINE).replace("ORDER", "as_written"), "x.yaml").protocol
    assert sum(point.operator_before is not None for point in protocol.worst_case()) == 1


@settings(max_examples=10)
@given(at_most=st.integers(1, 20), more=st.integers(1, 20))
def test_more_that_may_be_added_moves_no_seed(at_most: int, more: int) -> None:
    few, many = (made(f"refine: {{until: {{gap: 0.05}}, at_most: {n}}}") for n in (at_most, at_most + more))
    for curve, again in zip(few.refined_curves(), many.refined_curves(), strict=True):
        assert [point.seed for point in curve.spare] == [point.seed for point in again.spare[:at_most]]


@settings(max_examples=10)
@given(at_most=st.integers(1, 40))
def test_the_estimate_is_the_worst_case(at_most: int) -> None:
    protocol, plain = made(f"refine: {{until: {{theta_se: 0.01}}, at_most: {at_most}}}"), made("")
    worst, least = protocol.estimate(), plain.estimate()
    assert (worst.points, worst.added) == (least.points + 4 * at_most, 4 * at_most)
    assert worst.nd_changes == least.nd_changes
    period_s = 0.4
    added_s = 4 * at_most * (10 * period_s + 0.1 + 0.2)
    assert worst.duration_s == pytest.approx(least.duration_s + added_s)
    assert worst.bytes > least.bytes


def test_the_worst_case_is_in_the_order_of_taking() -> None:
    protocol = made()
    points = protocol.worst_case()
    groups = [curve_of(point) for point in points]
    assert len(points) == 23 + 16
    assert sum(a != b for a, b in pairwise(groups)) == len(set(groups)) - 1


def test_a_resolved_protocol_says_so_and_is_one_again() -> None:
    protocol = made()
    resolved = protocol.resolved()
    assert resolved["measurements"][0]["sweep"]["contrast"]["refine"] == {"until": {"gap": 0.05}, "at_most": 4}
    again = Protocol.model_validate(resolved)
    assert again.refined_curves() == protocol.refined_curves()
    assert again.resolved() == resolved


def test_the_seed_of_a_measurement_counts_for_what_is_added() -> None:
    text = TEXT.replace("  - name: family\n", "  - name: family\n    seed: 99\n")
    other = parse_protocol(text.replace("REFINE", REFINE).replace("ORDER", "as_written"), "x.yaml").protocol
    seeds = [{p.seed for c in protocol.refined_curves() for p in c.spare} for protocol in (made(), other)]
    assert seeds[0].isdisjoint(seeds[1])


@pytest.mark.parametrize(
    ("refine", "message"),
    [
        ("refine: {at_most: 3}", r"refined.yaml:18:17: .*refine: key 'until' is missing"),
        ("refine: {until: {gap: 0.1}}", r"refined.yaml:18:17: .*refine: key 'at_most' is missing"),
        (
            "refine: {until: {}, at_most: 3}",
            r"refined.yaml:18:25: .*until: needs one of theta_se, half_se and gap, not none",
        ),
        (
            "refine: {until: {gap: 0.1, theta_se: 0.1}, at_most: 3}",
            r"needs one of theta_se, half_se and gap, not theta_se and gap",
        ),
        (
            "refine: {until: {gap: 1.5}, at_most: 3}",
            r"refined.yaml:18:31: .*gap: 1.5 is out of range, must be below 1",
        ),
        ("refine: {until: {gap: 0}, at_most: 3}", r"gap: 0 is out of range, must be above 0"),
        ("refine: {until: {theta_se: -1}, at_most: 3}", r"theta_se: -1 is out of range, must be above 0"),
        ("refine: {until: {theta: 0.1}, at_most: 3}", r"until.theta: unknown key, did you mean 'theta_se'"),
        ("refine: {until: 0.1, at_most: 3}", r"until: 0.1 is not a mapping"),
        ("refine: {until: {gap: 0.1}, at_most: 0}", r"at_most: 0 is out of range, must be at least 1"),
        ("refine: {until: {gap: 0.1}, at_most: 2.5}", r"at_most: 2.5 is not a whole number"),
        ("refine: {until: {gap: 0.1}, at_most: 1001}", r"at_most: 1001 is out of range, must be at most 1000"),
        ("refine: 12", r"refine: 12 is not a mapping"),
    ],
)
def test_mistakes_have_their_place(refine: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as raised:
        made(refine)
    assert len(str(raised.value).splitlines()) == 1


def test_a_curve_needs_two_contrasts_to_begin_with() -> None:
    text = TEXT.replace("linspace: {start: 0.3, stop: 1.5, num: 5}", "values: [0.5]")
    with pytest.raises(InputError, match=r"x.yaml:18:17: .*refine: needs at least two different contrasts to begin"):
        parse_protocol(text.replace("REFINE", REFINE).replace("ORDER", "as_written"), "x.yaml")


def test_a_square_wave_has_no_theta() -> None:
    text = TEXT.replace("values: [0.5, 1]", "values: [0.5, 1], refine: {until: {theta_se: 0.01}, at_most: 3}")
    with pytest.raises(
        InputError, match=r"x.yaml:24:\d+: .*theta_se: a square wave does not tell the threshold"
    ) as raised:
        parse_protocol(text.replace("REFINE", "").replace("ORDER", "as_written"), "x.yaml")
    assert str(raised.value).endswith("ask for half_se or gap")


def test_what_may_be_added_counts_for_the_limit_of_points() -> None:
    text = TEXT.replace("illuminance_lux: [0.5, 10]", "illuminance_lux: {linspace: {start: 1, stop: 10, num: 60}}")
    with pytest.raises(InputError, match=r"these are 120603 points, at most 100000 are allowed"):
        parse_protocol(text.replace("REFINE", REFINE.replace("4", "1000")).replace("ORDER", "as_written"), "x.yaml")


def test_the_json_schema_knows_the_key() -> None:
    known = protocol_json_schema()["$defs"]
    assert set(known["Refine"]["properties"]) == {"until", "at_most"}
    assert set(known["Until"]["properties"]) == {"theta_se", "half_se", "gap"}
    assert "description" in known["Until"]["properties"]["theta_se"]
