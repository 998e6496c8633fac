"""The check: each rule against its closed form, and what the shipped protocols get."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from bench.run import CheckReport, check
from bench.station import Station, load_station
from protocols import LoadedProtocol, library, load_protocol, parse_protocol

StationMaker = Callable[..., Station]

HEAD = """\
format: evs-bench-protocol/1
title: t
roi: {x: 0, y: 0, width: 4, height: 4}
expect: {theta_on: %(on)s, theta_off: %(off)s, dark_light_lux: %(dark)s, bandwidth_hz: 200,
         refractory_period_s: 0.001}
pulses: 2
measurements:
"""
RESET_TEST = """\
  - name: "m"
    stimulus: {kind: reset_test, polarity: "%(polarity)s", reset_s: 0.1, test_s: %(test_s)s, gap_s: %(gap_s)s,
               reset_contrast: {scale: linear, value: %(reset)s}}
    sweep:
      illuminance_lux: [%(lux)s]
      contrast: {scale: log, values: %(contrasts)s}
"""
SQUARE = """\
  - name: "m"
    stimulus: {kind: square, frequency_hz: %(frequency)s}
    sweep:
      illuminance_lux: [100]
      contrast: {scale: log, values: [0.4]}
"""
# At a level of 0.5 to 1000 lux without a filter the source of the small station reaches all that is used below.
BASE = {
    "on": 0.3, "off": 0.25, "dark": 0.0, "polarity": "on", "test_s": 0.1, "gap_s": 0.1, "reset": 1.0, "lux": 100,
    "contrasts": "[0.3, 0.6]", "frequency": 5,
}  # fmt: skip


def _check(
    make_station: StationMaker, body: str = RESET_TEST, timing: str = "device", **changes: object
) -> CheckReport:
    text = (HEAD + body) % {**BASE, **changes}
    return check(parse_protocol(text, "t.yaml").protocol, make_station(timing=timing))


def _kinds(report: CheckReport) -> list[str]:
    return [finding.kind for finding in report.findings]


def test_a_sound_protocol_has_no_findings(make_station: StationMaker) -> None:
    report = _check(make_station)
    assert report.findings == ()
    assert not report.refused
    assert report.lines()[-1] == "this can be taken"


@pytest.mark.parametrize(("reset", "warned"), [(0.5, True), (0.83, True), (1.2, False)])
def test_a_reset_that_does_not_rearm(make_station: StationMaker, reset: float, warned: bool) -> None:
    """Dark light 1.924 times the level, as 146.26 mlux at 76 mlux: 50 % is 0.158 ln, and 0.25 needs 83 %."""
    lux, dark = 100.0, 192.447
    report = _check(make_station, dark=dark, reset=reset, contrasts="[1.2]")
    assert ("reset_does_not_rearm" in _kinds(report)) is warned
    if reset == 0.5:
        step = math.log(1.0 + 0.5 * lux / (lux + dark))
        assert step == pytest.approx(0.158, abs=5e-4)
        assert f"a step of {step:.3f} ln" in report.findings[0].message


def test_a_reset_below_the_baseline_returns_up(make_station: StationMaker) -> None:
    """An OFF test resets downward; its return must cross the ON threshold, here 0.6 ln and 10 % more."""
    assert "reset_does_not_rearm" in _kinds(_check(make_station, polarity="off", on=0.6, reset=0.9))
    assert "reset_does_not_rearm" not in _kinds(_check(make_station, polarity="off", on=0.6, reset=0.95))


@pytest.mark.parametrize(("lux", "impossible"), [(41.0, True), (43.0, False)])
def test_levels_from_which_no_off_event_is_possible(make_station: StationMaker, lux: float, impossible: bool) -> None:
    """From a level below E_d (e^theta - 1) even darkness is no OFF event: 100 lux * 0.419 = 41.9 lux at 0.35."""
    report = _check(make_station, polarity="off", dark=100.0, off=0.35, on=0.05, lux=lux, contrasts="[0.1, 2.0]")
    assert ("off_impossible" in _kinds(report)) is impossible
    assert ("threshold_not_reached" in _kinds(report)) is not impossible


def test_contrasts_that_never_reach_the_threshold(make_station: StationMaker) -> None:
    report = _check(make_station, contrasts="[0.1, 0.29]")
    assert _kinds(report) == ["threshold_not_reached"]
    assert report.findings[0].points == (0, 1)
    assert _kinds(_check(make_station, contrasts="[0.1, 0.31]")) == []


def test_parts_that_are_too_short(make_station: StationMaker) -> None:
    """Refractory period 1 ms and 5 tau at 200 Hz: 1 ms + 3.98 ms."""
    assert _kinds(_check(make_station, test_s=0.0049)) == ["test pulse_too_short"]
    assert _kinds(_check(make_station, gap_s=0.0049)) == ["gap_too_short"]
    assert _kinds(_check(make_station, test_s=0.0050, gap_s=0.0050)) == []
    assert _kinds(_check(make_station, SQUARE, frequency=101, off=0.3)) == [
        "square_cannot_tell_thresholds",
        "bright part_too_short",
        "dark part_too_short",
    ]


def test_a_square_wave_with_unequal_thresholds(make_station: StationMaker) -> None:
    report = _check(make_station, SQUARE, on=0.3, off=0.25)
    assert _kinds(report) == ["square_shows_other_threshold"]
    assert "the OFF threshold (0.250 ln) stays unseen" in report.findings[0].message


@pytest.mark.parametrize("off", [0.3, 0.2975])
def test_a_square_wave_with_equal_thresholds(make_station: StationMaker, off: float) -> None:
    report = _check(make_station, SQUARE, on=0.3, off=off)
    assert _kinds(report) == ["square_cannot_tell_thresholds"]
    assert "cannot tell thresholds that are equal" in report.findings[0].message


def test_a_source_that_is_timed_by_the_host_needs_time_to_settle(make_station: StationMaker) -> None:
    """An edge of ln 9 time constants of 0.1 ms, and 2 ms to settle: 2.22 ms."""
    fast = {"frequency": 250.0, "off": 0.3}
    assert "light_too_slow" in _kinds(_check(make_station, SQUARE, timing="host", **fast))
    assert "light_too_slow" not in _kinds(_check(make_station, SQUARE, timing="device", **fast))
    assert "light_too_slow" not in _kinds(_check(make_station, SQUARE, timing="host", frequency=200.0))


def test_what_the_station_cannot_do_is_an_error(make_station: StationMaker) -> None:
    report = _check(make_station, lux=990)
    assert report.refused
    assert report.lines()[-1] == "this cannot be taken: 1 error"
    assert "light source reaches 5 to 1000 lux" in report.findings[0].message


def test_findings_of_many_points_are_one_line(make_station: StationMaker) -> None:
    report = _check(make_station, test_s=0.001, contrasts="[0.3, 0.4, 0.5, 0.6]")
    assert [str(f) for f in report.findings] == [
        "warning: m, points 0-3: the test pulse of 0.001 s is shorter than the refractory period and 5 time "
        "constants of the pixel (0.004979 s)"
    ]
    assert report.to_dict()["findings"][0]["points"] == (0, 1, 2, 3)


@pytest.mark.parametrize("name", library.names())
def test_the_shipped_protocols_can_be_taken(name: str) -> None:
    report = check(load_protocol(name).protocol, load_station("simulated"))
    assert not report.refused
    # A sweep of the pulse width goes below what the others keep to, the study of the square wave shows what
    # imbalanced thresholds do to it, a diagnosis finds both thresholds from latencies, and a cutoff is where pixels
    # cease to answer: that is their point.
    known = {
        "low_light_cutoff": {"threshold_not_reached"},
        "pulse_width": {"test pulse_too_short"},
        "challenge": {"square_shows_other_threshold"},
        "paper_square": {"square_shows_other_threshold", "square_cannot_tell_thresholds"},
    }
    assert set(_kinds(report)) == known.get(name, set())


def test_one_of_a_thing_is_said_as_one(make_station: StationMaker, protocol: LoadedProtocol) -> None:
    report = check(protocol.protocol, make_station())
    one = replace(report, estimate=replace(report.estimate, points=1, nd_changes=1, operator_steps=1))
    assert one.lines()[0] == "a small run: 1 point on station box, 1 change of the filter, 1 operator step"
    two = replace(report, estimate=replace(report.estimate, points=2, nd_changes=0, operator_steps=2))
    assert two.lines()[0] == "a small run: 2 points on station box, 0 changes of the filter, 2 operator steps"


def test_rules_that_cannot_be_checked_are_named(make_station: StationMaker) -> None:
    text = (HEAD + RESET_TEST) % BASE
    known = check(parse_protocol(text, "x.yaml").protocol, make_station())
    assert known.not_checked == ()
    head, _, rest = text.partition("expect:")
    unknown = check(parse_protocol(head + rest[rest.index("pulses:") :], "x.yaml").protocol, make_station())
    line = (
        "not checked: whether the reset re-arms the pixel, and whether the contrasts reach the threshold (m): "
        "expect.dark_light_lux is not given"
    )
    assert line in unknown.lines()
    assert line.removeprefix("not checked: ") in unknown.to_dict()["not_checked"]
