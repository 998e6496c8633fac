"""The whole analysis: a recorded run, runs made by hand, and runs in which little or nothing is to be found."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.analysis import analyze
from bench.analysis.compact import compact
from bench.analysis.responses import latency_edges
from bench.analysis.results import Analysis, ResponseRow
from bench.analysis.tally import tally_point
from bench.store import Run

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


def _no_theta(rows: Sequence[ResponseRow]) -> None:
    del rows


def _analysed(run: Any, **options: Any) -> Analysis:
    return analyze(run, theta_fit=_no_theta, **options)


@pytest.fixture(scope="module")
def practice(data_folder: Path) -> Run:
    return Run.open(data_folder / "practice" / "practice_3")


@pytest.fixture(scope="module")
def practice_result(practice: Run) -> Analysis:
    return _analysed(practice)


def test_practice_run_is_read_whole(practice: Run, practice_result: Analysis) -> None:
    points = list(practice.points())
    assert practice_result.event_map.sum() == sum(p.n_events for p in points)
    assert practice_result.event_map.shape == (16, 16)
    assert practice_result.event_map_origin == (600, 300)
    squares = [p for p in points if p.waveform == "square"]
    assert len(practice_result.responses) == 2 * len(squares)
    assert len(practice_result.background) == 2 * (len(points) - len(squares))
    # Its references settle at the beginning: the rate in the dark falls, and nothing else is to be said.
    told = [w for w in practice_result.warnings if w.startswith("point")]
    assert all("the rate falls during the recording" in w for w in told)


def test_practice_curves_show_the_on_threshold_with_both_polarities(practice_result: Analysis) -> None:
    """Made with thresholds of 0.33 (ON) and 0.22 (OFF): a square wave shows the ON threshold twice."""
    assert practice_result.curves
    for curve in practice_result.curves:
        assert curve.limited_by == (None if curve.key.polarity == "on" else "on")
        assert curve.half.low <= curve.half.value <= curve.half.high < 0.33
        assert curve.half.high <= curve.intercept.high
    # Nothing in that run depends on the light: all levels agree.
    for polarity in ("on", "off"):
        same = [
            c.half.value for c in practice_result.curves if c.key.polarity == polarity and c.key.pulse_width_s > 0.1
        ]
        assert len(same) >= 2
        assert np.ptp(same) < 0.006


def test_practice_background_is_off_events(practice_result: Analysis) -> None:
    rates = {p: [b.rate for b in practice_result.background if b.polarity == p] for p in ("on", "off")}
    assert max(r.high for r in rates["on"]) < min(r.low for r in rates["off"])


def test_chunks_change_nothing(practice: Run, practice_result: Analysis) -> None:
    again = _analysed(practice, chunk=1000)
    for one, other in zip(practice_result.responses, again.responses, strict=True):
        for field in fields(ResponseRow):
            np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))
    np.testing.assert_array_equal(practice_result.event_map, again.event_map)
    assert practice_result.background == again.background
    assert [c.intercept for c in practice_result.curves] == [c.intercept for c in again.curves]


def _step_run(reset_test: Any, run: Any, events: Any, threshold: float, kind: int = 0) -> Any:
    """Return a run of noise-free pixels: they answer every reset, and after 5 ms every test over the threshold."""
    points = []
    for index, contrast in enumerate(threshold * (1.0 + 0.005 * np.arange(-4.5, 5.0))):
        rows = []
        for pulse in range(4):
            for k in range(12):
                x, y = 100 + k % 4, 50 + k // 4
                rows.append((int(pulse * 800_000 + 502_000), x, y, kind))
                if contrast > threshold:
                    rows.append((int(pulse * 800_000 + 605_000), x, y, 1 - kind))
        points.append(reset_test(contrast, 4, kind, stored=events(rows), index=index))
    return run(*points)


@pytest.mark.parametrize("kind", [0, 1])
def test_noise_free_threshold_is_found_within_the_step(reset_test: Any, run: Any, events: Any, kind: int) -> None:
    result = _analysed(_step_run(reset_test, run, events, 0.3, kind))
    (curve,) = result.curves
    assert curve.key.polarity == ("on" if kind == 0 else "off")
    for estimate in (curve.half, curve.intercept):
        assert estimate.value == pytest.approx(0.3, rel=1e-9)
        assert estimate.high - estimate.low == pytest.approx(0.0015)
    assert curve.answered_resets == 1.0
    assert curve.limited_by is None
    assert curve.warnings == ()
    answered = result.responses[-1]
    assert answered.latency_median_s == pytest.approx(0.005)
    assert answered.latency_iqr_s == 0.0
    assert answered.events_per_pulse == 1.0
    assert answered.latency_counts.sum() == answered.responses == 48
    assert result.pixel_maps[0].half == pytest.approx(0.3, rel=0.01)


def test_resets_that_stay_unanswered_are_flagged(reset_test: Any, run: Any, events: Any) -> None:
    stored = events([(502_000 + 800_000 * k, 100 + x, 50, 0) for k in range(4) for x in range(4)])
    result = _analysed(run(*[reset_test(c, 4, stored=stored, index=i) for i, c in enumerate((0.1, 0.2, 0.3, 0.4))]))
    assert [row.answered_resets for row in result.responses] == pytest.approx([1 / 3] * 4)
    assert result.curves[0].answered_resets == pytest.approx(1 / 3)
    assert any("resets" in text for text in result.curves[0].warnings)
    assert any("4 points" in text and "resets" in text for text in result.warnings)


def test_settings_windows_and_widths_make_curves_of_their_own(square: Any, run: Any) -> None:
    points = [
        square(0.3, index=0, bias={"bias_refr": -20.0, "bias_hpf": 0.0}),
        square(0.3, index=1, bias={"bias_refr": 0.0, "bias_hpf": 0.0}),
        square(0.3, index=2, bias={"bias_refr": 0.0, "bias_hpf": 0.0}, half_s=0.02),
    ]
    keys = {(c.key.settings, c.key.pulse_width_s) for c in _analysed(run(*points)).curves}
    assert keys == {("bias_refr=-20", 0.1), ("bias_refr=0", 0.1), ("bias_refr=0", 0.02)}


def test_windows_of_pixels_and_resets_are_told_apart_only_where_they_differ(reset_test: Any, run: Any) -> None:
    from protocols.points import Roi

    levels = [reset_test(0.3, baseline_lux=b, reset=r, index=i) for i, (b, r) in enumerate([(10.0, 0.4), (1.0, 0.5)])]
    assert {c.key.settings for c in _analysed(run(*levels)).curves} == {""}
    mixed = [reset_test(0.3, reset=0.4), reset_test(0.3, reset=0.5, index=1)]
    assert {c.key.settings for c in _analysed(run(*mixed)).curves} == {"reset +0.4 ln", "reset +0.5 ln"}
    moved = [reset_test(0.3), reset_test(0.3, roi=Roi(200, 60, 2, 2), index=1)]
    result = _analysed(run(*moved))
    assert len(result.curves) == 2
    assert result.event_map.shape == (12, 102)
    assert result.event_map_origin == (100, 50)


def test_points_of_the_same_contrast_are_added_up(square: Any, run: Any) -> None:
    result = _analysed(run(*[square(c, index=i) for i, c in enumerate((0.1, 0.2, 0.2, 0.3, 0.4))]))
    assert len(result.responses) == 10
    assert [c.log_contrast.tolist() for c in result.curves] == [[0.1, 0.2, 0.3, 0.4]] * 2


def test_nothing_at_all_is_no_error(run: Any) -> None:
    result = _analysed(run())
    assert (result.responses, result.curves, result.background) == ((), (), ())
    assert result.event_map.shape == (3, 4)


@pytest.mark.parametrize("change", ["no events", "no pulses", "all masked", "one contrast", "all in a gap"])
def test_points_in_which_little_is_found(square: Any, run: Any, change: str) -> None:
    everything = np.array([[x, y] for x in range(100, 104) for y in range(50, 53)], np.uint16)
    empty = np.zeros(0)
    changes: dict[str, dict[str, Any]] = {
        "no events": {},
        "no pulses": {"pulse_start_s": empty, "pulse_stop_s": empty, "pulse_kind": np.zeros(0, np.uint8)},
        "all masked": {"masked": everything},
        "one contrast": {},
        "all in a gap": {"gaps_s": np.array([[0.0, 2.0]])},
    }
    contrasts = (0.3,) if change == "one contrast" else (0.1, 0.2, 0.3, 0.4)
    result = _analysed(run(*[square(c, index=i, **changes[change]) for i, c in enumerate(contrasts)]))
    for curve in result.curves:
        assert np.isnan(curve.half.value)
        assert curve.half.note
    assert result.warnings
    assert result.pixel_maps == ()


def test_background_counts_pixels_and_seconds(point: Any, run: Any, events: Any) -> None:
    stored = events([(1_000_000, 100, 50, 1), (2_000_000, 101, 50, 1), (3_000_000, 103, 52, 0)])
    masked = np.array([[103, 52]], np.uint16)
    on, off = _analysed(run(point(stored=stored, masked=masked, gaps_s=np.array([[4.0, 6.0]])))).background
    assert (on.polarity, on.events) == ("on", 2)
    assert on.pixel_seconds == pytest.approx(11 * 8.0)
    assert on.rate.value == pytest.approx(2 / 88.0)
    assert on.rate.low < on.rate.value < on.rate.high
    assert (off.events, off.rate.low) == (0, 0.0)
    assert "upper limit" in off.rate.note


def test_progress_and_theta_are_handed_through(reset_test: Any, run: Any, events: Any) -> None:
    told: list[tuple[int, int]] = []
    seen: list[int] = []

    def theta(rows: Sequence[ResponseRow]) -> None:
        seen.append(len(rows))

    made = _step_run(reset_test, run, events, 0.3)
    analyze(made, progress=lambda done, total: told.append((done, total)), theta_fit=theta, pixel_maps=False)
    assert seen == [10]
    assert told[-1] == (1, 1)


def test_latency_edges_are_shared_and_end_with_the_window() -> None:
    short, long = latency_edges(0.04), latency_edges(0.2)
    assert short[0] == long[0] == 0.0
    assert (short[-1], long[-1]) == (0.04, 0.2)
    np.testing.assert_array_equal(short[1:-1], long[1 : short.size - 1])
    assert np.all(np.diff(long) > 0)
    assert long * 1e6 == pytest.approx(np.round(long * 1e6), abs=1e-6)


@pytest.mark.parametrize(("second_half", "words"), [(1, ["falls"]), (9, ["rises"]), (4, [])])
def test_a_rate_that_changes_during_the_recording_is_told(
    point: Any, run: Any, events: Any, second_half: int, words: list[str]
) -> None:
    pixels = [(x, y) for x in range(100, 104) for y in range(50, 53)]
    rows = [(1000 * i, x, y, 1) for x, y in pixels for i in range(3 + x % 3)]
    rows += [(6_000_000 + 1000 * i, x, y, 1) for x, y in pixels for i in range(second_half + x % 2 - y % 2)]
    warnings = _analysed(run(point(stored=events(rows)))).warnings
    assert [w.split()[4] for w in warnings if "during the recording" in w] == words


def test_a_rate_of_single_busy_pixels_is_not_told(point: Any, run: Any, events: Any) -> None:
    rows = [(1000 * i, 100, 50, 1) for i in range(1000)]
    assert not _analysed(run(point(stored=events(rows)))).warnings


def test_events_after_the_end_are_told_and_not_counted(point: Any, run: Any, events: Any) -> None:
    found = _analysed(run(point(stored=events([(1_000_000, 100, 50, 1), (10_000_001, 100, 50, 1)]))))
    assert sum(row.events for row in found.background) == 1
    assert any("1 events lie after the end" in w for w in found.warnings)


def test_what_is_kept_of_a_point_is_small(reset_test: Any, square: Any, run: Any, events: Any) -> None:
    stored = events([(610_000, 100, 50, 1)])
    kept = _analysed(run(reset_test(stored=stored), square(stored=stored, index=1))).responses
    assert {row.per_pixel.dtype.itemsize for row in kept} == {1}
    tally = compact(tally_point(reset_test(stored=stored)).groups[0], square=False)
    arrays = (tally.answers, tally.given, tally.followed, tally.rearmed)
    assert [array.strides[0] for array in arrays] == [1, 0, 0, 0]
    assert tally.latencies.size == 10_001
    assert tally.answers.sum() == tally.latencies.sum() == 1
