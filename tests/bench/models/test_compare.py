"""A run beside a model of it: the recording is made again as it was taken, and errors are those the model expects."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.models.compare import compare_run
from bench.models.comparison import ChiSquare, Compared, Comparison, PixelCovariance, within
from bench.models.simulation import on_sensor, point_chain, recorded_light, simulate_point, with_recorded_dead_time
from bench.report.figures import agreement
from bench.store import Run
from bench.store.data import PointData, RunHeader, Sensor
from drivers.events.types import empty_events
from protocols.errors import InputError
from protocols.points import Roi
from sim_backend.pixel import FastEngine, PixelModel, ReferenceEngine
from sim_backend.pixel.effects import HotPixels, Leak, StrayLight, ThresholdMismatch

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

ROI = Roi(40, 30, 8, 8)
SENSOR = Sensor("made", 1280, 720, 4.86e-6, 0.6)
ENGINE = FastEngine(dt_s=1e-4)
PIXEL = PixelModel(noise_rms=0.05, corner_hz=120.0, theta_on=0.3, theta_off=0.25, refractory_s=8e-3)
MISMATCHED = PIXEL + ThresholdMismatch(sigma_on=0.04, sigma_off=0.03)


@dataclass(frozen=True, slots=True)
class Taken(PointData):
    """A point whose events lie in memory."""

    stored: npt.NDArray[np.void] = field(default_factory=empty_events)

    def events(self, chunk: int = 1_000_000) -> Iterator[npt.NDArray[np.void]]:
        yield self.stored


@dataclass(frozen=True, slots=True)
class Memory:
    taken: tuple[PointData, ...]
    header: RunHeader = field(default_factory=lambda: RunHeader("made", SENSOR, ROI))

    def points(self) -> Iterator[PointData]:
        yield from self.taken


def point(index: int, contrast: float, periods: int = 10, half_s: float = 0.05, **changes: Any) -> Taken:
    """Return a square wave from dark to bright, or constant light where the contrast is 0."""
    edges = np.arange(2 * periods + 1) * half_s if contrast else np.zeros(1)
    pulses = len(edges) - 1
    values: dict[str, Any] = {
        "path": Path(f"{index:06}.h5"),
        "index": index,
        "waveform": "square" if contrast else "constant",
        "polarity": "both",
        "baseline_lux": 10.0,
        "log_contrast": contrast,
        "duration_s": (2 * periods + 1) * half_s,
        "nd_od": 0.0,
        "refractory_s": 8e-3,
        "temperature_c": math.nan,
        "roi": ROI,
        "n_events": 0,
        "stimulus_t_s": edges,
        "stimulus_lux": 10.0 * np.exp(contrast * (np.arange(len(edges)) % 2)),
        "pulse_start_s": edges[1:],
        "pulse_stop_s": edges[1:] + half_s,
        "pulse_kind": (np.arange(pulses) % 2).astype(np.uint8),
        "pulse_valid": np.ones(pulses, np.bool_),
        "pulse_log_contrast": np.full(pulses, contrast),
        "triggers_t_us": np.zeros(0, np.int64),
        "triggers_p": np.zeros(0, np.uint8),
        "masked": np.zeros((0, 2), np.uint16),
        "gaps_s": np.zeros((0, 2)),
        "bias": {},
        "quality": {},
        "attributes": {},
    }
    return Taken(**(values | changes))


def taken(asked: Taken, model: PixelModel, sensor: int, seed: int) -> Taken:
    """Return the point with the events that a sensor of this model sends."""
    parts = simulate_point(asked, model, ENGINE, sensor_seed=10_000 + sensor, seed=1000 * seed + asked.index)
    return replace(asked, stored=np.concatenate([empty_events(), *parts]))


def run_of(model: PixelModel, seed: int = 1, contrasts: tuple[float, ...] = (0.15, 0.25, 0.3, 0.4, 0.0)) -> Memory:
    """Return a run that one sensor of this model took."""
    return Memory(tuple(taken(point(i, c), model, seed, seed) for i, c in enumerate(contrasts)))


def test_the_light_is_that_of_the_point() -> None:
    asked = point(0, 0.3, nd_od=3.0)
    light = recorded_light(asked)
    assert np.array_equal(light.t_s, asked.stimulus_t_s)
    assert np.array_equal(light.lux, asked.stimulus_lux)
    assert np.all(np.asarray(light.nd_od) == 3.0)
    assert light.rise_tau_s == 0.0


@pytest.mark.parametrize(
    ("t_s", "lux", "message"),
    [
        (np.zeros(0), np.zeros(0), "000000.h5: no stimulus is recorded"),
        (np.array([0.1]), np.ones(1), "000000.h5: light history: times must ascend from 0 s"),
    ],
)
def test_a_point_without_a_stimulus_is_refused(
    t_s: npt.NDArray[np.float64], lux: npt.NDArray[np.float64], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        recorded_light(point(0, 0.0, stimulus_t_s=t_s, stimulus_lux=lux))


@pytest.mark.parametrize(
    ("attributes", "stray_lux"), [({}, 0.2), ({"ambient": "open"}, 0.2), ({"ambient": "capped"}, 0.0)]
)
def test_stray_light_acts_only_when_open(attributes: dict[str, Any], stray_lux: float) -> None:
    chain = point_chain(point(0, 0.3, attributes=attributes), PIXEL + StrayLight(illuminance_lux=0.2), 1)
    assert chain.stray_lux == stray_lux


def test_photoconversion_is_that_of_the_runs_sensor() -> None:
    sensor = Sensor("other", 640, 480, 1.5e-5, 0.5, 2e16)
    conversion = on_sensor(PIXEL, sensor).photoconversion
    assert (conversion.eta, conversion.pitch_m, conversion.photons_per_lux) == (0.5, 1.5e-5, 2e16)


def test_each_view_of_each_point_is_compared() -> None:
    told: list[tuple[int, int]] = []
    result = compare_run(run_of(PIXEL), PIXEL, engine=ENGINE, sensors=2, progress=lambda *now: told.append(now))
    assert [(p.point, p.view) for p in result.points] == [
        *((i, view) for i in range(4) for view in ("response_on", "response_off")),
        (4, "background_on"),
        (4, "background_off"),
    ]
    assert told == [(i, 10) for i in range(10)]
    first = result.points[0]
    assert (first.log_contrast, first.pulses, first.pixels) == (0.15, 10, ROI.pixels)
    assert first.width_s == pytest.approx(0.05)
    assert first.monte_carlo_error == pytest.approx(first.standard_error / math.sqrt(2.0))
    assert len(result.responses()) == 8
    assert len(result.background()) == 2
    assert all(0.02 < p.expected < 0.98 for p in result.responses(informative=True))


def test_the_same_seed_gives_the_same_numbers_and_another_does_not() -> None:
    one, again, other = (compare_run(run_of(PIXEL), PIXEL, engine=ENGINE, sensors=1, seed=s) for s in (1, 1, 2))
    assert one.points == again.points
    assert one.points != other.points


def test_an_error_is_never_zero() -> None:
    """Finer than by one answer of all pixels and pulses a share does not go, nor a rate than by one event."""
    still = replace(PIXEL, noise_rms=0.0)
    result = compare_run(run_of(still, contrasts=(0.1, 0.5, 0.0)), still, engine=ENGINE, sensors=3)
    assert [p.expected for p in result.points] == [0.0, 0.0, 1.0, 1.0, 0.0, 0.0]
    for p in result.points:
        one = 1.0 / (ROI.pixels * (10 if p.is_response else 1.05))
        assert p.standard_error == pytest.approx(one)
        assert p.error == pytest.approx(math.hypot(one, one / 3.0))
        assert p.z == 0.0
        assert not p.informative
    assert result.chi_square() == ChiSquare(0, 0, 1.0, 0)


def test_the_error_is_that_between_pixels() -> None:
    """With thresholds far apart and little noise a pixel answers always or never: each counts as one trial."""
    model = replace(PIXEL, noise_rms=0.01, effects=(ThresholdMismatch(sigma_on=0.1, sigma_off=0.0),))
    found = compare_run(run_of(model, contrasts=(0.3,)), model, engine=ENGINE, sensors=8).points[0]
    assert 0.4 < found.expected < 0.8
    one_trial_each = math.sqrt(found.expected * (1.0 - found.expected) / ROI.pixels)
    assert found.standard_error == pytest.approx(one_trial_each, rel=0.1)


def test_masked_pixels_do_not_count() -> None:
    """A hot pixel that was switched off is left out of both."""
    model = PIXEL + HotPixels(fraction=0.2, rate_hz=200.0)
    hot = np.flatnonzero(point_chain(point(0, 0.3), model, 10_001).hot_hz)
    assert 3 < len(hot) < 30
    masked = np.stack([ROI.x + hot % ROI.width, ROI.y + hot // ROI.width], axis=1).astype(np.uint16)
    run = Memory((replace(taken(point(0, 0.0), model, 1, 1), masked=masked),))
    found = compare_run(run, PIXEL, engine=ENGINE, sensors=2).points[0]
    assert found.pixels == ROI.pixels - len(hot)
    assert found.measured < 1.0


def test_a_window_of_its_own_stands_alone() -> None:
    """Points of other pixels share nothing with the others; the chi-squares add up."""
    elsewhere = Roi(100, 100, 6, 6)
    points = (point(0, 0.25), point(1, 0.25, roi=elsewhere))
    run = Memory(tuple(taken(p, PIXEL, 1, 1) for p in points))
    result = compare_run(run, PIXEL, engine=ENGINE, sensors=4)
    assert [(c.rows.tolist(), c.pixels, c.simulated) for c in result.covariances] == [
        ([0, 1], 64, 256),
        ([2, 3], 36, 144),
    ]
    assert result.chi_square().freedom == 4


def test_settings_ask_for_a_model_each() -> None:
    points = (point(0, 0.2, bias={"bias_diff_on": 0.0}), point(1, 0.2, bias={"bias_diff_on": 40.0}))
    more_sensitive = replace(PIXEL, theta_on=0.2, theta_off=0.2)
    models = {0.0: PIXEL, 40.0: more_sensitive}
    run = Memory(tuple(taken(p, models[p.bias["bias_diff_on"]], 1, 1) for p in points))
    with pytest.raises(InputError, match=r"000001.h5: another bias setting than in 000000.h5"):
        compare_run(run, PIXEL, engine=ENGINE)
    result = compare_run(run, lambda p: models[p.bias["bias_diff_on"]], engine=ENGINE)
    assert within(result.responses(), 4.0) == 1.0
    assert result.points[2].expected > result.points[0].expected + 0.2


def test_dead_times_may_be_those_of_the_points() -> None:
    points = (point(0, 0.0), point(1, 0.0, refractory_s=0.1), point(2, 0.0, refractory_s=math.nan))
    with pytest.raises(InputError, match="another dead time"):
        compare_run(Memory(points), PIXEL, engine=ENGINE)
    model_of = with_recorded_dead_time(replace(PIXEL, refractory_s=0.02))
    assert [model_of(p).refractory_s for p in points] == [8e-3, 0.1, 0.02]


def test_nonsense_is_refused() -> None:
    with pytest.raises(InputError, match="0 simulated sensors"):
        compare_run(run_of(PIXEL), PIXEL, engine=ENGINE, sensors=0)
    one = Memory((point(0, 0.3, roi=Roi(0, 0, 1, 1)),))
    with pytest.raises(InputError, match="1 simulated pixels; expected 2 or more"):
        compare_run(one, PIXEL, engine=ENGINE, sensors=1)


def test_a_run_without_points() -> None:
    result = compare_run(Memory(()), PIXEL, engine=ENGINE)
    assert result.points == ()
    assert math.isnan(within(result.points))
    assert agreement.prepare(result) is None


# The chi-square


def hand_made(
    difference: tuple[float, ...], covariance: npt.NDArray[np.float64], pixels: int, simulated: int
) -> Comparison:
    errors = np.maximum(np.sqrt(np.diag(covariance)), 1e-3)  # at least one answer of all
    points = tuple(
        Compared(
            i,
            "response_on",
            10.0,
            0.3,
            0.05,
            10,
            pixels,
            0.5 + d,
            0.5,
            e / math.sqrt(pixels),
            e / math.sqrt(simulated),
        )
        for i, (d, e) in enumerate(zip(difference, errors, strict=True))
    )
    return Comparison("made", points, (PixelCovariance(np.arange(len(points)), covariance, pixels, simulated),))


def test_with_one_point_it_is_the_square_of_students_t() -> None:
    """``T^2 = t^2`` with m - 1 degrees of freedom."""
    from scipy.stats import t

    found = hand_made((0.02,), np.array([[0.04]]), 100, 400).chi_square()
    z = 0.02 / math.sqrt(0.04 * (1 / 100 + 1 / 400))
    assert found.sum_of_squares == pytest.approx(z**2)
    assert found.value == pytest.approx(z**2 * 397 / 399)
    assert found.p_value == pytest.approx(2.0 * t.sf(z, 399))


def test_points_that_move_together_count_once() -> None:
    """Two equal columns are one; what they differ in cannot be."""
    covariance = 0.04 * np.ones((2, 2))
    single = hand_made((0.02,), covariance[:1, :1], 100, 400).chi_square()
    double = hand_made((0.02, 0.02), covariance, 100, 400).chi_square()
    assert double.freedom == 1
    assert double.value == pytest.approx(single.value)
    assert double.sum_of_squares == pytest.approx(2.0 * single.sum_of_squares)


def test_a_point_in_which_simulated_pixels_do_not_differ_does_not_silence_the_others() -> None:
    """Pixels without noise may all answer every other pulse."""
    alone = hand_made((0.2,), np.array([[0.04]]), 100, 400).chi_square()
    both = hand_made((0.2, 0.0), np.diag([0.04, 0.0]), 100, 400).chi_square()
    assert (both.value, both.freedom, both.p_value) == (alone.value, 1, alone.p_value)
    assert alone.p_value < 1e-6
    neither = hand_made((0.0,), np.array([[0.0]]), 100, 400).chi_square()
    assert (neither.freedom, neither.p_value) == (0, 1.0)


def test_too_few_pixels_for_so_many_points_give_no_number() -> None:
    found = hand_made((0.0,) * 6, 0.04 * np.eye(6), 100, 7).chi_square()
    assert math.isnan(found.value)
    assert math.isnan(found.p_value)


@pytest.mark.slow
@pytest.mark.parametrize("model", [PIXEL, MISMATCHED], ids=["equal pixels", "mismatch"])
def test_runs_of_the_model_itself_have_even_p_values(model: PixelModel) -> None:
    """Frozen thresholds move all points together, ON and OFF share their recording: the chi-square knows."""
    from scipy.stats import kstest

    contrasts = (0.2, 0.25, 0.28)
    found = [compare_run(run_of(model, s, contrasts), model, engine=ENGINE, sensors=4, seed=s) for s in range(24)]
    chi = [result.chi_square() for result in found]
    assert min(c.freedom for c in chi) >= 3
    assert kstest([c.p_value for c in chi], "uniform").pvalue > 1e-3
    per_freedom = np.array([c.per_freedom for c in chi])
    assert per_freedom.mean() == pytest.approx(1.0, abs=4.0 * per_freedom.std() / math.sqrt(len(chi)))
    every = [p for result in found for p in result.responses()]
    assert within(every) > 0.99


@pytest.mark.parametrize(
    "wrong",
    [replace(PIXEL, theta_on=0.33), replace(PIXEL, noise_rms=0.06), PIXEL + Leak(rate_per_s=0.6)],
    ids=["threshold", "noise", "leak"],
)
def test_another_model_is_told_from_the_true_one(wrong: PixelModel) -> None:
    run = run_of(PIXEL)
    assert compare_run(run, PIXEL, engine=ENGINE).chi_square().p_value > 1e-3
    assert compare_run(run, wrong, engine=ENGINE).chi_square().p_value < 1e-5


# A run of an independent simulator


@dataclass(frozen=True, slots=True)
class Some:
    """Some points of a run."""

    run: Run
    chosen: frozenset[int]

    @property
    def header(self) -> RunHeader:
        return self.run.header

    def points(self) -> Iterator[PointData]:
        return (p for p in self.run.points() if p.index in self.chosen)


@pytest.mark.slow
def test_the_run_of_an_independent_simulator_agrees_with_the_model_of_its_parameters(data_folder: Path) -> None:
    """Where the curves are steep, for both pulse widths, at two lights; the docs have all points (agreement.md)."""
    run = Run.open(data_folder / "practice" / "practice_3")
    steep = frozenset([28, 29, 34, 35])
    truth = PixelModel(noise_rms=0.045, corner_hz=150.0, theta_on=0.33, theta_off=0.22, refractory_s=8e-3)
    result = compare_run(Some(run, steep | {30, 36, 54, 61}), truth, engine=ReferenceEngine(dt_s=2e-5), sensors=1)
    assert len(result.responses()) == 16
    assert len(result.responses(informative=True)) == 12
    assert within(result.responses()) >= 0.95
    assert within(result.responses(informative=True)) >= 0.95
    assert result.chi_square().p_value > 1e-3
    # It would have been seen if a threshold were 5 % off.
    wrong = compare_run(Some(run, steep), replace(truth, theta_on=0.347), engine=FastEngine(dt_s=2e-5))
    assert wrong.chi_square().p_value < 1e-4


# The figure


def test_the_figure_shows_every_response() -> None:
    result = compare_run(run_of(PIXEL), PIXEL, engine=ENGINE, sensors=1)
    numbers = agreement.prepare(result)
    assert numbers is not None
    assert [(r.polarity, r.contrast.tolist()) for r in numbers.responses] == [
        (p, [0.15, 0.25, 0.3, 0.4]) for p in ("on", "off")
    ]
    z = [p.z for p in result.responses() if p.view == "response_on"]
    assert numbers.responses[0].z == pytest.approx(z)
    assert numbers.largest == pytest.approx(max(abs(p.z) for p in result.responses()))
    figure = agreement.draw(numbers)
    against, residuals = figure.axes
    assert against.get_xlabel() == "expected response probability"
    low, high = residuals.get_ylim()
    assert -low == high > max(3.0, numbers.largest)
