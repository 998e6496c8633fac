"""What views see in events that were written down by hand, and in those of a model of their own."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.stats import norm

from bench.diagnosis.expected.residuals import expectation, measured
from bench.diagnosis.recorded.recording import Frame, Recording
from bench.diagnosis.recorded.summary import summarise, summarise_each
from bench.diagnosis.views.registry import SHOWN, VIEWS
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects import ThresholdMismatch

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from bench.diagnosis.recorded.summary import Summary

PIXEL = PixelModel(noise_rms=0.045, corner_hz=150.0, theta_on=0.3, theta_off=0.25, refractory_s=8e-3)
PIXELS = 64


def look(taken: Any) -> Summary:
    """Return what all views say about a point."""
    return summarise(Recording(Frame(taken), taken.events()), VIEWS)


def value(summary: Summary, view: str, part: str) -> float:
    """Return one statistic."""
    at = [i for i, label in enumerate(summary.labels) if (label.view, label.part) == (view, part)]
    assert len(at) == 1
    return float(summary.ratio[at[0]])


def test_answers_written_by_hand(point: Callable[..., Any], recorded: Callable[..., Any]) -> None:
    """Ten ON windows from 50 ms, ten OFF windows from 100 ms, of 50 ms each, in turn."""
    summary = look(
        recorded(
            point(0, 0.4),
            [
                (50_400, 0, 0, 1),  # first ON pulse, 0.4 ms after its edge
                (51_000, 1, 0, 0),  # wrong polarity
                (59_400, 0, 0, 1),  # second event of the answer, 9 ms later
                (150_900, 0, 0, 1),  # second ON pulse: 0.9 ms
                (200_100, 5, 0, 0),  # an OFF pulse
            ],
        )
    )
    answers = PIXELS * 10
    assert value(summary, "response", "on") == pytest.approx(2 / answers)
    assert value(summary, "response", "off") == pytest.approx(1 / answers)
    assert value(summary, "extra_events", "on") == pytest.approx(1 / answers)
    assert value(summary, "other_polarity", "on") == pytest.approx(1 / answers)
    assert value(summary, "latency", "on") == pytest.approx(0.5 * (math.log(0.4e-3) + math.log(0.9e-3)))
    assert value(summary, "latency_spread", "on") == pytest.approx(math.log(0.9 / 0.4) ** 2)
    assert value(summary, "second_event", "on") == pytest.approx(math.log(9e-3))
    assert value(summary, "halves", "on") == pytest.approx(-2 / (PIXELS * 5))
    assert math.isnan(value(summary, "second_event", "off"))


def spread_answers(latency_us: npt.NDArray[np.int64]) -> list[tuple[int, int, int, int]]:
    """Return one ON event for each pixel (8 x 8) and each of ten pulses, so late: (64, 10)."""
    found = [
        (50_000 + 100_000 * j + int(latency_us[i, j]), i % 8, i // 8, 1) for i in range(PIXELS) for j in range(10)
    ]
    return sorted(found)


def quantiles_of(taken: Any) -> tuple[list[float], list[float]]:
    """Return the three quantiles of the latencies of ON, and their standard errors."""
    found = summarise(Recording(Frame(taken), taken.events()), SHOWN)
    mine = [i for i, label in enumerate(found.labels) if label.part == "on"]
    assert [found.labels[i].view for i in mine] == ["latency_10", "latency_50", "latency_90"]
    return [float(found.ratio[i]) for i in mine], [math.sqrt(found.covariance()[i, i]) for i in mine]


def test_quantiles_of_the_latency(point: Callable[..., Any], recorded: Callable[..., Any]) -> None:
    """They are those of all answers; of a normal distribution they are known to the root of p (1 - p) / n, by f."""
    late_us = np.rint(5000.0 * np.exp(0.3 * np.random.default_rng(8).standard_normal((PIXELS, 10)))).astype(np.int64)
    values, errors = quantiles_of(recorded(point(0, 0.4), spread_answers(late_us)))
    assert values == pytest.approx(np.log(np.quantile(1e-6 * late_us, [0.1, 0.5, 0.9])), abs=1e-3)
    for value, error, share in zip(values, errors, (0.1, 0.5, 0.9), strict=True):
        density = norm.pdf(norm.ppf(share)) / 0.3
        assert error == pytest.approx(math.sqrt(share * (1.0 - share) / late_us.size) / density, rel=0.3)
        assert abs(value - (math.log(5e-3) + 0.3 * norm.ppf(share))) < 4.0 * error


def test_quantiles_of_pixels_that_differ_are_known_less_well(
    point: Callable[..., Any], recorded: Callable[..., Any]
) -> None:
    """Ten pulses of a pixel that always answers alike tell as much as one."""
    rng = np.random.default_rng(9)
    own = np.exp(0.3 * rng.standard_normal((PIXELS, 1))) * np.ones((1, 10))
    mixed = rng.permutation(own.ravel()).reshape(own.shape)
    alike, apart = (
        quantiles_of(recorded(point(0, 0.4), spread_answers(np.rint(5000.0 * one).astype(np.int64))))
        for one in (own, mixed)
    )
    assert alike[0] == pytest.approx(apart[0])
    # a standard deviation of 64 pixels is known to 9 %, and this is a ratio of two
    assert np.array(alike[1]) / apart[1] == pytest.approx(math.sqrt(10.0), rel=0.4)


def test_quantiles_of_times_that_are_all_the_same(point: Callable[..., Any], recorded: Callable[..., Any]) -> None:
    values, errors = quantiles_of(recorded(point(0, 0.4), spread_answers(np.full((PIXELS, 10), 700))))
    assert values == pytest.approx([math.log(7e-4)] * 3)
    assert errors == pytest.approx([0.0] * 3, abs=1e-6)  # of logarithms near 7, as differences of squares


def test_quantiles_of_several_sensors_are_those_of_each(
    point: Callable[..., Any], recorded: Callable[..., Any]
) -> None:
    rng = np.random.default_rng(10)
    one, other = (
        recorded(point(0, 0.4), spread_answers(rng.integers(500, size, (PIXELS, 10)))) for size in (3000, 9000)
    )
    both = summarise_each(Recording(Frame(one), one.events(), other.events()), SHOWN, whole=False)
    for taken, found in zip((one, other), both, strict=True):
        alone = summarise(Recording(Frame(taken), taken.events()), SHOWN)
        assert np.array_equal(found.top, alone.top)
        assert np.array_equal(found.bottom, alone.bottom)


def test_no_latency_where_the_events_told_when_the_light_changed(
    point: Callable[..., Any], recorded: Callable[..., Any]
) -> None:
    events = [(50_400, 0, 0, 1), (59_400, 0, 0, 1), (150_900, 0, 0, 1), (200_100, 5, 0, 0)]
    timed = point(0, 0.4)
    untimed = replace(timed, attributes={**timed.attributes, "time_axis": "from_events"})
    seen, blind = look(recorded(timed, events)), look(recorded(untimed, events))
    views = {label.view for label in seen.labels}
    assert views - {label.view for label in blind.labels} == {"latency", "latency_spread"}
    assert value(blind, "response", "on") == value(seen, "response", "on")
    assert value(blind, "second_event", "on") == value(seen, "second_event", "on")


def test_background_written_by_hand(point: Callable[..., Any], recorded: Callable[..., Any]) -> None:
    """A pixel that ticks once a second, and one that sends both polarities."""
    ticks = [(1_000_000 * k + 500_000, 3, 3, 1) for k in range(5)]
    summary = look(recorded(point(0, 0.0), sorted([*ticks, (700_000, 1, 1, 1), (2_700_000, 1, 1, 0)])))
    assert value(summary, "background", "on") == pytest.approx(6 / (PIXELS * 5.0))
    assert value(summary, "background", "off") == pytest.approx(1 / (PIXELS * 5.0))
    assert value(summary, "same_polarity", "both") == pytest.approx(4 / 5)
    assert value(summary, "intervals", "on") == pytest.approx(0.0)
    assert value(summary, "regularity", "on") == pytest.approx(0.0)
    assert value(summary, "outliers", "on") == pytest.approx(1 / PIXELS)


def test_neighbours_that_fire_together(point: Callable[..., Any], recorded: Callable[..., Any]) -> None:
    summary = look(
        recorded(
            point(0, 0.0),
            [(1000, 2, 2, 1), (1005, 2, 3, 1), (2000, 2, 2, 1), (2005, 2, 3, 0), (3000, 2, 2, 1), (3005, 4, 2, 1)],
        )
    )
    # Of 8 x 8 pixels 112 pairs are neighbours; the pair that is none counts against chance.
    assert value(summary, "neighbours", "both") == pytest.approx((1.0 - 112 / (64 * 63 / 2 - 112)) / 6)


def test_pixels_that_all_fire_at_once_have_nothing_in_common_with_their_neighbours(
    point: Callable[..., Any], recorded: Callable[..., Any]
) -> None:
    """A hundred times, each in another order: in the same one the same pixels would follow each other every time."""
    times = range(10_000, 510_000, 5_000)
    summary = look(recorded(point(0, 0.0), [(t, x, y, 1) for t in times for y in range(8) for x in range(8)]))
    neighbours, others = 112, 64 * 63 / 2 - 112
    # Each of three events before one is of a neighbour by chance, and counts 1; any other counts less than nothing.
    each = (neighbours + others * (neighbours / others) ** 2) / (neighbours + others)
    assert abs(value(summary, "neighbours", "both")) < 4.0 * math.sqrt(3.0 * each / (64 * len(times)))


def test_events_outside_window_end_and_gaps_do_not_count(
    point: Callable[..., Any], recorded: Callable[..., Any]
) -> None:
    asked = point(0, 0.0, gaps_s=np.array([[1.0, 2.0]]), masked=np.array([[40, 30]], np.uint16))
    events = [(500_000, 1, 0, 1), (600_000, 0, 0, 1), (700_000, 60, 0, 1), (1_500_000, 1, 0, 1), (5_100_000, 1, 0, 1)]
    assert value(look(recorded(asked, events)), "background", "on") == pytest.approx(1 / ((PIXELS - 1) * 4.0))


def test_recordings_of_a_point_add_up(point: Callable[..., Any], run_of: Callable[..., Any]) -> None:
    one, other = (look(run_of([point(0, 0.3)], PIXEL, seed).taken[0]) for seed in (1, 2))
    both = one + other
    assert value(both, "response", "on") == pytest.approx(
        0.5 * (value(one, "response", "on") + value(other, "response", "on"))
    )
    assert both.recordings == 2


def test_the_errors_are_those_with_which_runs_of_one_model_scatter(
    point: Callable[..., Any], run_of: Callable[..., Any]
) -> None:
    """Sixty sensors with mismatched pixels: the standard error of the response is their scatter, not the binomial."""
    model = PIXEL + ThresholdMismatch(sigma_on=0.04, sigma_off=0.04)
    summaries = [look(run_of([point(0, 0.3)], model, seed).taken[0]) for seed in range(1, 61)]
    at = next(i for i, label in enumerate(summaries[0].labels) if (label.view, label.part) == ("response", "on"))
    shares = np.array([s.ratio[at] for s in summaries])
    claimed = np.sqrt(np.mean([s.covariance()[at, at] for s in summaries]))
    binomial = math.sqrt(shares.mean() * (1.0 - shares.mean()) / (PIXELS * 10))
    assert claimed > 1.3 * binomial
    # The scatter of 60 is known to 1 / sqrt(2 * 59), the mean variance is much sharper.
    assert shares.std(ddof=1) == pytest.approx(claimed, rel=4.0 / math.sqrt(2 * 59))


def test_residuals_of_the_true_model_have_unit_variance_and_no_long_tails(
    point: Callable[..., Any], run_of: Callable[..., Any]
) -> None:
    """Each whitened residual of twenty runs beside six simulated sensors of their own model."""
    points = [point(0, 0.25), point(1, 0.35), point(2, 0.6), point(3, 0.0)]
    summaries = [[look(t) for t in run_of(points, PIXEL, seed).taken] for seed in range(1, 27)]
    expected_by = summaries[20:]
    summed = [sum(column[1:], column[0]) for column in zip(*expected_by, strict=True)]
    found = []
    for one in summaries[:20]:
        run = measured(one)
        expected = expectation(run, summed)
        for root, where in zip(expected.roots, run.points, strict=True):
            live = np.abs(root).sum(axis=1) > 0.05
            found.append((root @ (run.value[where] - expected.value[where]))[live])
    z = np.concatenate(found)
    assert z.size > 500
    # Rare events scatter less than is stated of them; nothing may scatter more.
    assert 0.4 < np.mean(z**2) < 1.15
    # Rare events make it lumpy, never wide.
    assert np.mean(np.abs(z) > 3.0) < 0.01
    assert np.max(np.abs(z)) < 6.0
