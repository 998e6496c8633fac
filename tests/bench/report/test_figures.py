"""The numbers behind the figures, against analyses made by hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from bench.analysis.results import Analysis
from bench.report import example
from bench.report.families import Family, families_of
from bench.report.figures import background, event_map, latency, pixel, pixel_maps, resets, scurves, style, thresholds
from bench.report.trace import ModelTrace

Maker = Callable[..., Any]


def family_of(analysis: Analysis) -> Family:
    (family,) = families_of([curve.key for curve in analysis.curves])
    return family


def test_s_curves_are_sorted_by_polarity_and_light(family_analysis: Analysis) -> None:
    numbers = scurves.prepare(family_analysis.curves, family_of(family_analysis))
    assert numbers is not None
    assert [panel.polarity for panel in numbers.panels] == ["on", "off"]
    assert [curve.step for curve in numbers.panels[0].curves] == list(range(8))
    assert numbers.labels[0] == "76 mlux"
    assert numbers.labels[4] == "3 lux"
    contrasts = np.concatenate([curve.log_contrast for curve in family_analysis.curves])
    assert numbers.lowest < contrasts.min()
    assert numbers.highest > contrasts.max()
    assert numbers.has_theta


def test_readings_stand_on_their_curves(family_analysis: Analysis) -> None:
    numbers = scurves.prepare(family_analysis.curves, family_of(family_analysis))
    assert numbers is not None
    curve = numbers.panels[0].curves[0]
    assert curve.half_height == pytest.approx(0.5 * (0.02 + 0.985))
    assert curve.intercept_height == pytest.approx(0.02 + 0.99 * 0.965)


def test_without_a_floor_the_reading_stands_on_the_fit(key_of: Maker, curve_of: Maker, unknown: Maker) -> None:
    curve = curve_of(key_of(), np.linspace(0.1, 0.9, 30), floor=unknown("1", "no floor"))
    numbers = scurves.prepare([curve], families_of([curve.key])[0])
    assert numbers is not None
    assert numbers.panels[0].curves[0].half_height == pytest.approx(0.5 * (0.02 + 0.985), abs=0.01)


def test_a_curve_without_points_is_left_out(key_of: Maker, curve_of: Maker) -> None:
    curve = curve_of(key_of(), np.zeros(0))
    assert scurves.prepare([curve], families_of([curve.key])[0]) is None


def test_threshold_series_hold_the_readings(family_analysis: Analysis) -> None:
    numbers = thresholds.prepare(family_analysis.curves, family_of(family_analysis))
    assert numbers is not None
    assert [(s.polarity, s.reading) for s in numbers.series] == [
        (polarity, reading) for polarity in ("on", "off") for reading in ("half", "intercept", "theta")
    ]
    theta = numbers.series[2]
    assert theta.x.tolist() == sorted(theta.x.tolist())
    # ON at 76 mlux above 146 mlux of dark light: ln(1 + (1 + 146/76) (e^0.35 - 1)) = 0.800
    assert theta.value[0] == pytest.approx(0.800, abs=0.001)
    assert (theta.high - theta.low) == pytest.approx(0.016)


def test_one_level_has_no_threshold_figure(key_of: Maker, curve_of: Maker) -> None:
    curve = curve_of(key_of(), np.linspace(0.1, 0.9, 30))
    assert thresholds.prepare([curve], families_of([curve.key])[0]) is None


def test_readings_that_are_not_known_are_left_out(key_of: Maker, curve_of: Maker, unknown: Maker) -> None:
    contrasts = np.linspace(0.1, 0.9, 30)
    curves = [curve_of(key_of("on", lux), contrasts, theta=None) for lux in (1.0, 10.0, 100.0)]
    curves.append(curve_of(key_of("on", 0.1), contrasts, half=unknown("ln", "flat"), theta=None))
    numbers = thresholds.prepare(curves, families_of([c.key for c in curves])[0])
    assert numbers is not None
    assert {s.reading: s.x.size for s in numbers.series} == {"half": 3, "intercept": 4}


def test_latencies_add_up_over_contrasts(family_analysis: Analysis) -> None:
    numbers = latency.prepare(family_analysis.responses, family_of(family_analysis))
    assert numbers is not None
    polarity, members = numbers.panels[0]
    rows = [r for r in family_analysis.responses if r.key.polarity == polarity and r.key.baseline_lux == 0.076]
    assert members[0].counts.sum() == sum(r.latency_counts.sum() for r in rows)
    widths = np.diff(np.log10(np.concatenate(([5e-6], members[0].edges_s[1:]))))
    assert (members[0].share * widths).sum() == pytest.approx(1.0)
    assert members[0].median_s.size == sum(r.responses >= 10 for r in rows)
    assert 0.0 < numbers.shortest_s < 0.004 < numbers.longest_s <= 0.04


def test_no_answers_no_latencies(key_of: Maker, row_of: Maker) -> None:
    row = row_of(key_of(), 0, 0.1, 0.0)
    assert latency.prepare([row], families_of([row.key])[0]) is None


def test_rates_without_events_are_limits_and_no_light_has_its_own_place(background_of: Maker) -> None:
    rows = [background_of(i, p, lux, n) for i, lux in enumerate((0.0, 1.0, 10.0)) for p, n in (("on", 9), ("off", 0))]
    numbers = background.prepare(rows)
    assert numbers is not None
    on, off = numbers.rates
    assert not on.limit.any()
    assert off.limit.all()
    assert on.rate_hz == pytest.approx(9 / 1920)
    assert numbers.dark_at is not None
    assert 0.0 < on.place[0] < numbers.dark_at < off.place[0] < on.place[1]
    assert numbers.y_limits[0] < off.high_hz.min() / 2.6


def test_recordings_at_one_level_stand_side_by_side(background_of: Maker) -> None:
    numbers = background.prepare([background_of(i, "on", 3.0, 20 + i) for i in range(5)])
    assert numbers is not None
    assert np.unique(numbers.rates[0].place).size == 5


def test_no_background_no_figure() -> None:
    assert background.prepare([]) is None


def test_resets_and_ends(family_analysis: Analysis) -> None:
    numbers = resets.prepare(family_analysis.responses, family_analysis.curves, family_of(family_analysis))
    assert numbers is not None
    assert numbers.lowest_share == pytest.approx(0.93)
    assert len(numbers.answered) == len(numbers.ends) == 16
    assert (np.diff(numbers.answered[0].contrast) > 0).all()


def test_square_waves_have_no_reset_figure(key_of: Maker, row_of: Maker) -> None:
    row = row_of(key_of(waveform="square"), 0, 0.5, 0.9, answered_resets=math.nan)
    assert resets.prepare([row], [], families_of([row.key])[0]) is None


def test_the_spread_of_pixels_is_split(family_analysis: Analysis) -> None:
    spread = pixel_maps.spread_of(family_analysis.pixel_maps[0])
    known = family_analysis.pixel_maps[0].half[np.isfinite(family_analysis.pixel_maps[0].half)]
    assert (spread.pixels, spread.of) == (191, 192)
    assert spread.total == pytest.approx(known.std(ddof=1))
    assert spread.counting == pytest.approx(0.01)
    assert spread.own**2 + spread.counting**2 == pytest.approx(spread.total**2)


def test_the_map_that_knows_most_pixels_is_shown(family_analysis: Analysis) -> None:
    numbers = pixel_maps.prepare(family_analysis.pixel_maps, (10, 20))
    assert numbers is not None
    assert [spread.key.polarity for spread, _ in numbers.maps] == ["on", "off"]
    assert numbers.maps[0][0].key.baseline_lux == 300.0
    assert (numbers.x, numbers.y, numbers.others) == (10, 20, 2)


def test_the_event_map_is_in_sensor_coordinates(constant: Analysis) -> None:
    numbers = event_map.prepare(constant)
    assert numbers is not None
    assert (numbers.x, numbers.y) == (632, 352)
    assert numbers.loudest == (636, 355)
    assert (numbers.total, numbers.silent) == (41, 191)
    assert numbers.log_scale


@pytest.mark.parametrize("most", [0, 1, 30])
def test_every_pixel_is_in_the_histogram(family_analysis: Analysis, most: int) -> None:
    rng = np.random.default_rng(1)
    events = rng.integers(0, most + 1, (9, 7))
    values = {name: getattr(family_analysis, name) for name in Analysis.__slots__}
    numbers = event_map.prepare(Analysis(**{**values, "event_map": events}))
    assert numbers is not None
    assert np.histogram(events, numbers.edges)[0].sum() == 63


def test_the_example_is_a_pixel_that_answers_as_most_do(family_analysis: Analysis, run_of: Maker, key_of: Maker,
                                                         row_of: Maker) -> None:  # fmt: skip
    run = run_of(points=4)
    rows = [row_of(key_of(), i, 0.2 + 0.1 * i, p) for i, p in enumerate((0.1, 0.5, 0.84, 1.0))]
    values = {name: getattr(family_analysis, name) for name in Analysis.__slots__}
    chosen = example.choose_example(run, Analysis(**{**values, "responses": tuple(rows)}))
    assert chosen is not None
    assert chosen.point.index == 2
    assert 632 <= chosen.x < 640
    assert chosen.y == 355
    # The first pulse at 0.24 s, periods of 0.28 s: four pulses, the last ends at 1.12 s.
    assert (chosen.start_s, chosen.stop_s) == pytest.approx((0.0, 1.12 + 0.028))


def test_pixel_numbers_hold_what_falls_into_the_stretch(run_of: Maker) -> None:
    point = next(iter(run_of(points=1).points()))
    chosen = example.Example(point, 633, 355, 0.2, 0.5)
    t_s, polarity = example.pixel_events(chosen)
    assert ((t_s >= 0.2) & (t_s <= 0.5)).all()
    trace = ModelTrace(np.linspace(0.0, 1.0, 101), np.zeros(101), 0.3, 0.25)
    numbers = pixel.prepare(chosen, t_s, polarity, trace)
    assert numbers.light_t_s == pytest.approx([0.2, 0.24, 0.28, 0.38, 0.42, 0.5])
    assert numbers.light_lux[0] == numbers.light_lux[2]
    assert numbers.windows_s == pytest.approx(np.array([[0.24, 0.28]]))
    assert numbers.on_s.size + numbers.off_s.size == t_s.size
    assert numbers.trace is not None
    assert numbers.trace.t_s.min() >= 0.2
    assert numbers.trace.t_s.max() <= 0.5


def test_ticks_are_round_and_inside() -> None:
    assert style.log_axis_ticks(0.05, 400.0).tolist() == pytest.approx([0.1, 1.0, 10.0, 100.0])
    assert style.log_axis_ticks(1.5, 12.0).tolist() == pytest.approx([2.0, 5.0, 10.0])
    assert style.log_axis_ticks(2.9, 3.1).tolist() == pytest.approx([3.0])
    assert style.log_axis_ticks(2e-4, 9e-3).tolist() == pytest.approx([3e-4, 1e-3, 3e-3])
    assert style.log_axis_ticks(3.1, 3.2).size == 1
    ticks = style.linear_contrast_ticks(0.0, 1.6)
    assert {0.1, 1.0, 2.0} <= set(ticks.tolist())
    assert (np.diff(np.log1p(ticks)) >= 0.055 * 1.6).all()


def test_light_levels_can_be_told_apart_in_grey() -> None:
    luminance = [np.dot(style.step_colour(i, 8)[:3], (0.2126, 0.7152, 0.0722)) for i in range(8)]
    assert (np.diff(luminance) > 0.03).all()
    assert luminance[-1] < 0.8
    assert len(set(style.MARKERS[:8])) == 8
