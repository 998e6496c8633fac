"""What is found of points that were not taken as they should have been, and in which words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.run.verdict import Limits, Verdict
from drivers.events.types import empty_triggers
from tests.bench.run.test_verdict_points import ROI, Taken, constant, events_at, reset_test


def _only(verdict: Verdict) -> str:
    """Return the one reason of a verdict."""
    assert len(verdict.reasons) == 1, verdict.reasons
    return verdict.reasons[0]


def _without(taken: Taken, lost: list[tuple[float, float]]) -> Taken:
    """Return a point whose stream was lost from time to time, as the camera tells it."""
    t_s = taken.events["t"] / 1e6
    kept = np.ones(len(t_s), bool)
    for begin_s, end_s in lost:
        kept &= (t_s < begin_s) | (t_s >= end_s)
    record = replace(taken.record, gaps_s=tuple(lost), quality={**taken.record.quality, "overflows": len(lost)})
    return replace(taken, events=taken.events[kept], record=record)


def test_gaps_matter_where_answers_are_expected() -> None:
    taken = reset_test()
    window_s = taken.record.pulses.start_s
    between = _without(taken, [(window_s[3] - 0.03, window_s[3] - 0.02)]).judged()
    assert between.light == "amber"
    assert _only(between).startswith("events are missing: 1 gap, 0.01 s in all, 0.16 % of the recording, in 0 of 40")
    one = _without(taken, [(window_s[3], window_s[3] + 0.01)]).judged()
    assert one.light == "amber"
    assert "in 1 of 40 response windows" in _only(one)
    three = _without(taken, [(t_s, t_s + 0.01) for t_s in window_s[3:6]]).judged()
    assert three.light == "red"
    assert "in 3 of 40 response windows" in three.reasons[0]


def test_gaps_that_overlap_count_once() -> None:
    taken = constant(duration_s=20.0)
    whole = _without(taken, [(3.0, 3.2), (3.1, 3.3), (3.15, 3.2)]).judged()
    assert whole.light == "amber"
    assert _only(whole) == "events are missing: 3 gaps, 0.3 s in all, 1.5 % of the recording"
    assert _without(taken, [(3.0, 3.5)]).judged().light == "red"


@pytest.mark.parametrize(
    ("quality", "light", "words"),
    [
        ({"dropped_buffers": 2}, "red", "it is not known when: 2 transfers dropped"),
        ({"overflows": 1}, "red", "it is not known when: 1 overflows of the camera"),
        ({"decode_errors": 5}, "amber", "5 decode errors beside"),
        ({"decode_errors": 5000}, "red", "5000 decode errors beside"),
        ({"time_doubtful": 1, "time_note": "by a period"}, "amber", "the time axis is doubtful: by a period"),
        ({"triggers_without_edge": 7}, "amber", "7 triggers belong to none of the 160 edges of the light"),
        ({"triggers_without_edge": 1}, "green", ""),
        ({"hot_pixels": 3}, "amber", "the camera reports 3 hot pixels"),
        ({"bytes_received": 2_000_000_000}, "amber", "bytes/s came; the camera transfers 2e+08 at most"),
    ],
)
def test_what_the_quality_says(quality: dict[str, int | str], light: str, words: str) -> None:
    taken = reset_test()
    verdict = taken.with_record(quality={**taken.record.quality, **quality}).judged()
    assert verdict.light == light
    assert words in (_only(verdict) if light != "green" else "")


def _lost_triggers(taken: Taken, lost: int) -> Taken:
    assert taken.record.stimulus.trigger is not None
    trigger = taken.record.stimulus.trigger.copy()
    trigger[1 : lost + 1] = -1
    return taken.with_record(stimulus=replace(taken.record.stimulus, trigger=trigger))


def test_triggers_that_did_not_come() -> None:
    taken = reset_test()
    assert _lost_triggers(taken, 1).judged().light == "green"
    some = _lost_triggers(taken, 10).judged()
    assert (some.light, _only(some)) == ("amber", "10 of 160 edges of the light have no trigger")
    assert _lost_triggers(taken, 100).judged().light == "red"


def test_no_trigger_at_all() -> None:
    taken = reset_test()
    stimulus = replace(taken.record.stimulus, trigger=None)
    by_source = replace(taken.with_record(stimulus=stimulus), triggers=empty_triggers())
    by_source.record.attributes["time_axis"] = "edges_known"
    assert by_source.judged().light == "amber"
    assert by_source.judged(Limits(triggers_expected=False)).light == "green"
    missing = by_source.judged(Limits(triggers_expected=True))
    assert missing.light == "red"
    assert _only(missing).startswith("no triggers came for 160 edges of the light, which are taken to be where")
    by_events = by_source.with_record(attributes={"time_axis": "from_events"})
    assert by_events.judged().light == "green"
    assert by_events.judged(Limits(triggers_expected=True)).light == "amber"
    came = replace(by_source, triggers=taken.triggers[:9]).judged()
    assert came.light == "red"
    assert "the 9 triggers do not fit the 160 edges" in _only(came)


def test_a_wire_is_expected_once_triggers_came() -> None:
    taken, limits = reset_test(), Limits()
    assert limits.learned(constant().seen(), 0).triggers_expected is None
    assert limits.learned(taken.seen(), taken.record.stimulus.trigger.size - 1).triggers_expected  # type: ignore[union-attr]


def test_swapped_triggers_are_told_where_both_kinds_came() -> None:
    taken = reset_test()
    taken.triggers["p"] ^= 1
    verdict = taken.judged()
    assert verdict.light == "amber"
    assert _only(verdict).startswith("the triggers are swapped: 160 of 160")
    taken.triggers["p"] = 1  # a pulse for each edge, of which the rising one counts
    assert taken.judged().light == "green"


def test_silence() -> None:
    taken = reset_test()
    dark = replace(taken, events=taken.events[:0])
    limits = Limits(dark_light_lux=0.1)
    verdict = dark.judged(limits)
    assert verdict.light == "red"
    assert _only(verdict).startswith(
        "silence: 80 steps of the light of 2 thresholds or more, and 0 answers per pixel"
    )
    half = replace(taken, events=taken.events[taken.events["t"] < 5e5 * taken.record.duration_s])
    verdict = half.judged(limits)
    assert verdict.light == "red"
    assert verdict.reasons[0].startswith("silence from 3.")
    assert verdict.reasons[1].startswith("drift: ")


def test_silence_is_no_reason_where_nothing_must_be_seen() -> None:
    taken = reset_test()
    dark = replace(taken, events=taken.events[:0])
    assert dark.judged(Limits(dark_light_lux=1000.0)).light == "green"  # dark light hides the steps
    capped = replace(dark.planned, point=replace(dark.planned.point, ambient="capped"))
    assert replace(dark, planned=capped).judged().light == "green"
    settings = replace(dark.planned.point.settings, theta_on=0.7, theta_off=0.7)
    high = replace(dark.planned, point=replace(dark.planned.point, settings=settings))
    assert replace(dark, planned=high).judged().light == "green"
    assert constant(rate_hz=0.0).judged().light == "green"


def _thinned(taken: Taken, before: float, after: float, seed: int = 3) -> Taken:
    """Return a point that keeps a share of its events in its first half, and another in its second."""
    share = np.where(taken.events["t"] < 5e5 * taken.record.duration_s, before, after)
    return replace(taken, events=taken.events[np.random.default_rng(seed).random(len(share)) < share])


@pytest.mark.parametrize(("before", "after", "light"), [(1.0, 0.7, "amber"), (0.3, 1.0, "red"), (1.0, 0.97, "green")])
def test_drift_within_a_point(before: float, after: float, light: str) -> None:
    verdict = _thinned(reset_test(), before, after).judged()
    assert verdict.light == light
    assert light == "green" or _only(verdict).startswith("drift: ")


def test_drift_of_constant_light() -> None:
    taken = constant(rate_hz=5.0)
    changed = _thinned(taken, 1.0, 0.5).judged()
    assert changed.light == "amber"
    assert " events in 0.23 s of constant light: " in _only(changed)
    first = taken.events["t"] < 2e6  # more events at the beginning are what every sensor shows
    more = np.sort(np.concatenate([taken.events, np.repeat(taken.events[first], 4)]), order="t")
    assert replace(taken, events=more).judged().light == "green"


def test_a_flash_in_constant_light() -> None:
    taken = constant(rate_hz=0.5)
    pixel = np.arange(ROI.pixels)
    flash = events_at(np.full(64, 11.0) + 1e-4 * pixel, pixel % 8, pixel // 8, np.zeros(64, np.int64))
    events = np.sort(np.concatenate([taken.events, flash]), order="t")
    verdict = replace(taken, events=events).judged()
    assert verdict.light == "amber"
    assert "the light changed: at 11 s 6" in _only(verdict)


def test_light_before_and_after() -> None:
    taken = reset_test()
    for after, light in ((100.0, "green"), (101.9, "green"), (95.0, "amber"), (50.0, "red")):
        attributes = {**taken.record.attributes, "bench_lux_before": 100.0, "bench_lux_after": after}
        assert taken.with_record(attributes=attributes).judged().light == light


def test_a_sensor_that_becomes_warm() -> None:
    taken = reset_test()
    attributes = {**taken.record.attributes, "temperature_before_c": 20.0}
    verdict = taken.with_record(attributes=attributes).judged()
    assert _only(verdict) == "the sensor went from 20.0 to 25.0 degrees Celsius during the point"
    assert taken.with_record(attributes=attributes, temperature_c=float("nan")).judged().light == "green"


def test_one_pixel_that_never_stops() -> None:
    taken = reset_test()
    n = int(1e4 * taken.record.duration_s)
    hot = events_at(np.linspace(0.0, n * 1e-4, n, endpoint=False), np.full(n, 3), np.full(n, 2), np.arange(n) % 2)
    events = np.sort(np.concatenate([taken.events, hot]), order="t")
    verdict = replace(taken, events=events).judged()
    assert verdict.light == "amber"
    assert _only(verdict) == "1 pixel gave 88 % of the events: (13, 22) at 1e+04 events/s"


def test_pixels_that_fire_whenever_they_can() -> None:
    taken = constant(rate_hz=0.0, duration_s=10.0)
    t_s, pixel = np.meshgrid(np.arange(0.0, 10.0, 0.011), np.arange(64))
    t_s, pixel = t_s.ravel() + 1e-4 * pixel.ravel(), pixel.ravel()
    events = events_at(t_s, pixel % 8, pixel // 8, np.arange(len(t_s)) % 2)
    verdict = replace(taken, events=events).judged()
    assert verdict.light == "amber"
    assert _only(verdict).startswith(
        "the dead time of 10 ms was the limit: 90.9 events/s per pixel in constant light"
    )


def test_a_rate_without_scatter_is_that_of_the_readout() -> None:
    taken = constant(rate_hz=0.0, duration_s=2.0).with_record(refractory_s=float("nan"))
    n = 30_000
    rng = np.random.default_rng(2)
    queue = events_at(
        np.linspace(1.0, 1.15, n, endpoint=False), rng.integers(0, 8, n), rng.integers(0, 8, n), np.ones(n, np.int64)
    )
    reasons = replace(taken, events=queue).judged().reasons
    assert any(r.startswith("the readout was the limit: 2e+05 events/s without scatter") for r in reasons)
    free = queue.copy()
    free["t"] = np.sort(1e6 * (1.0 + 0.15 * rng.random(n)))
    assert not any("readout" in reason for reason in replace(taken, events=free).judged().reasons)


def test_a_rate_near_what_can_be_transferred() -> None:
    verdict = constant(rate_hz=20.0).judged(Limits(max_rate_eps=5e3))
    assert "events/s; the camera transfers about 5e+03" in _only(verdict)


def test_events_from_outside_the_window() -> None:
    taken = constant(rate_hz=5.0)
    taken.events["x"][::100] = 300
    assert "events came from outside the window" in _only(taken.judged())


def test_invalid_pulses_and_the_order_of_reasons() -> None:
    taken = reset_test()
    valid = np.ones(40, np.uint8)
    valid[:1] = 0
    pulses = replace(taken.record.pulses, valid=valid)
    assert taken.with_record(pulses=pulses).judged().light == "amber"
    valid[:10] = 0
    quality = {**taken.record.quality, "decode_errors": 5}
    verdict = taken.with_record(pulses=pulses, quality=quality).judged()
    assert verdict.light == "red"
    assert verdict.reasons[0] == "10 of 40 pulses are not valid"
    assert verdict.reasons[1].startswith("5 decode errors")
