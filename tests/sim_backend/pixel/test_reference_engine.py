"""The reference engine against a plain loop, and what must not change its events."""

from __future__ import annotations

import dataclasses
import functools
import math
import operator
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pytest

from drivers.events.types import EVENT_DTYPE
from protocols.errors import InputError
from protocols.points import Roi
from sim_backend.pixel import LightHistory, PixelModel, ReferenceEngine, build_chain
from sim_backend.pixel.chain import pixel_ids
from sim_backend.pixel.effects import DarkCurrent, LightRiseTime, StrayLight, ThresholdMismatch, effects
from sim_backend.pixel.engines import reference_kernels as kernels
from sim_backend.pixel.engines.reference import processors
from sim_backend.pixel.light import LightSampler
from sim_backend.pixel.philox import philox4x32, split_seed

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel import Chain

    Events = npt.NDArray[np.void]
    Step = Literal["exact", "euler"]

ROI = Roi(30, 40, 16, 9)  # 144 pixels: two whole groups of lanes and a part of one
BUSY = (
    PixelModel(noise_rms=0.09, corner_hz=300.0, theta_on=0.3, theta_off=0.25, refractory_s=2e-3)
    + DarkCurrent(mean_fa=5.0, spread=0.4)
    + ThresholdMismatch(sigma_on=0.03, sigma_off=0.03)
)
STEPS = LightHistory(
    np.array([0.0, 0.02, 0.0301, 0.06, 0.0817, 0.12]), np.array([0.3, 0.9, 0.2, 4.0, 0.0, 0.3]), rise_tau_s=7e-4
)
DURATION_S = 0.15
#: Where the default is too weak for a small window, or needs something beside it.
VISIBLE: dict[str, dict[str, float]] = {
    "hot_pixels": {"fraction": 0.1, "rate_hz": 500.0},
    "event_rate_limit": {"max_rate_eps": 1e4},
    "leak": {"rate_per_s": 1.0},
    "parasitic_photocurrent": {"rate_per_s_per_lux": 1.0},
    "comparator_delay": {"delay_s": 1e-4},
}
#: Each effect at once; flicker and jitter make the order of events a test of its own.
EVERYTHING = functools.reduce(
    operator.add,
    [
        cls(**VISIBLE.get(name, {}))
        for name, cls in effects().items()
        if name not in {"dark_current", "threshold_mismatch"}
    ],
    BUSY,
)


def events_of(
    model: PixelModel,
    light: LightHistory = STEPS,
    seed: int = 1,
    roi: Roi = ROI,
    duration_s: float = DURATION_S,
    sensor_seed: int = 5,
    **engine: Any,
) -> Events:
    chain = build_chain(model, roi, sensor_seed)
    parts = list(ReferenceEngine(**engine).events(chain, light, duration_s, seed))
    return np.concatenate([np.empty(0, EVENT_DTYPE), *parts])


def box_muller(words: Any) -> list[float]:
    """Return the four normal numbers of four words, in double precision and with library functions."""
    z = []
    for a, b in ((words[0], words[1]), (words[2], words[3])):
        radius = math.sqrt(-2.0 * math.log(((int(a) >> 1) + 0.5) / 2**31))
        angle = np.int32(np.uint32((int(b) << 2) & 0xFFFFFFFF)) * math.pi / 2**33
        pair = [math.cos(angle), math.sin(angle)]
        if int(b) >> 31:
            pair.reverse()
        sign = -1.0 if (int(b) >> 30) & 1 else 1.0
        z += [sign * radius * p for p in pair]
    return z


def plain_loop(chain: Chain, light: LightHistory, duration_s: float, seed: int, dt_s: float, rho: float) -> Events:
    """Return the events by the definition: one pixel after the other, one sample after the other."""
    samples = math.ceil(duration_s / dt_s - 1e-6)
    lux = LightSampler(light, dt_s).lux(0, samples) + chain.stray_lux
    sigma = chain.noise_rms * math.sqrt(1.0 - rho**2)
    events = []
    for i, pixel in enumerate(pixel_ids(chain.x, chain.y)):
        u = np.log(np.maximum(chain.gain_fa_per_lux[i] * lux + chain.dark_fa[i], 1e-4))
        counter = np.zeros((samples // 4 + 1, 4), np.uint32)
        counter[:, 0], counter[:, 1] = np.arange(len(counter)), pixel
        z = [x for words in philox4x32(counter, split_seed(seed)) for x in box_muller(words)]
        counter[0, 2] = kernels.PURPOSE_START
        v = u[0] + chain.noise_rms * box_muller(philox4x32(counter[:1], split_seed(seed))[0])[0]
        reference, wake = v, -1
        for n in range(1, samples):
            v = rho * v + (1.0 - rho) * u[n] + sigma * z[n - 1]
            fired = n > wake and (v - reference >= chain.theta_on[i] or v - reference <= -chain.theta_off[i])
            if fired:
                events.append((round(n * dt_s * 1e6), chain.x[i], chain.y[i], v > reference))
                wake = n + round(chain.refractory_s[i] / dt_s)
            if n == wake:
                reference = v
    return np.sort(np.array(events, EVENT_DTYPE), order=["t", "y", "x"])


@pytest.mark.parametrize("step", ["exact", "euler"])
@pytest.mark.parametrize("refractory_s", [0.0, 1e-5, 2.004e-3])
def test_the_engine_is_the_plain_loop(step: Step, refractory_s: float) -> None:
    model = dataclasses.replace(BUSY, refractory_s=refractory_s) + StrayLight(illuminance_lux=0.05)
    roi = Roi(30, 40, 9, 1)
    chain = build_chain(model, roi, 5)
    engine = ReferenceEngine(step=step)
    expected = plain_loop(chain, STEPS, DURATION_S, 1, engine.dt_s, engine.rho(chain.corner_hz))
    assert len(expected) > 100
    assert 0 < expected["p"].sum() < len(expected)
    assert np.array_equal(events_of(model, roi=roi, step=step), expected)


def test_events_come_in_order_of_time_then_row_then_column() -> None:
    events = events_of(BUSY, stretch_samples=100)
    assert len(events) > 1000
    assert np.array_equal(events, np.sort(events, order=["t", "y", "x"]))
    assert events["t"].min() >= 0
    assert events["t"].max() < DURATION_S * 1e6


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("stretch_samples", [1, 999, 100_000])
def test_threads_and_stretches_change_nothing(threads: int, stretch_samples: int) -> None:
    expected = events_of(BUSY)
    assert np.array_equal(events_of(BUSY, threads=threads, stretch_samples=stretch_samples), expected)


def test_the_window_changes_nothing() -> None:
    expected = events_of(BUSY)
    for roi in (Roi(33, 41, 5, 2), Roi(20, 35, 30, 16), Roi(37, 44, 1, 1)):
        events = events_of(BUSY, roi=roi)
        inside = _inside(events, ROI)
        wanted = _inside(expected, roi)
        assert len(inside) > 0
        assert np.array_equal(inside, wanted)


def _inside(events: Events, roi: Roi) -> Events:
    x, y = events["x"], events["y"]
    return events[(x >= roi.x) & (x < roi.x + roi.width) & (y >= roi.y) & (y < roi.y + roi.height)]


def test_a_longer_recording_begins_like_a_shorter_one() -> None:
    long = events_of(BUSY, duration_s=DURATION_S)
    short = events_of(BUSY, duration_s=0.0777)
    assert np.array_equal(long[long["t"] < 77_700], short)


def test_another_seed_gives_other_events_and_the_same_seed_the_same() -> None:
    assert np.array_equal(events_of(BUSY, seed=3), events_of(BUSY, seed=3))
    assert not np.array_equal(events_of(BUSY, seed=3), events_of(BUSY, seed=4))
    assert not np.array_equal(events_of(BUSY, seed=3), events_of(BUSY, seed=3 + (1 << 32)))


@pytest.mark.effect(shows="null")
@pytest.mark.parametrize("effect_id", sorted(effects()))
def test_an_effect_at_its_null_value_changes_no_event(effect_id: str) -> None:
    base = PixelModel(noise_rms=0.09, corner_hz=300.0, refractory_s=2e-3)
    if effect_id != "dark_current":
        base += DarkCurrent()  # without it no one sees an error of the absolute light
    light = LightHistory(STEPS.t_s, STEPS.lux, nd_od=3.0)
    expected = events_of(base, light=light)
    assert len(expected) > 100
    assert np.array_equal(events_of(base + effects()[effect_id].null(), light=light), expected)
    visible = effects()[effect_id](**VISIBLE.get(effect_id, {}))
    assert not np.array_equal(events_of(base + visible, light=light), expected)


@pytest.mark.effect(shows="null")
@pytest.mark.parametrize("effect_id", sorted(effects()))
def test_an_effect_at_its_null_value_changes_no_event_of_a_pixel_with_all_the_others(effect_id: str) -> None:
    base = EVERYTHING.without(effect_id)
    light = LightHistory(STEPS.t_s, STEPS.lux, nd_od=3.0)
    expected = events_of(base, light=light, duration_s=0.05)
    assert len(expected) > 100
    assert np.array_equal(events_of(base + effects()[effect_id].null(), light=light, duration_s=0.05), expected)


def test_the_rise_time_is_the_same_from_the_light_and_from_the_model() -> None:
    model = BUSY + LightRiseTime(tau_s=7e-4)
    assert np.array_equal(events_of(model, light=LightHistory(STEPS.t_s, STEPS.lux)), events_of(BUSY))
    with pytest.raises(InputError, match="both given"):
        events_of(model)


def test_more_events_than_there_is_room_for_are_handed_over_in_parts() -> None:
    model = PixelModel(noise_rms=1.0, corner_hz=5e4, theta_on=0.01, theta_off=0.01, refractory_s=0.0)
    chain = build_chain(model, Roi(0, 0, 8, 8), 0)
    engine = ReferenceEngine()
    light = LightHistory.constant(1.0)
    events = np.concatenate(list(engine.events(chain, light, 0.01, 1)))
    assert len(events) > 0.98 * 64 * 1000
    few = Roi(3, 2, 2, 1)
    expected = plain_loop(build_chain(model, few, 0), light, 0.01, 1, engine.dt_s, engine.rho(5e4))
    assert np.array_equal(_inside(events, few), expected)


def test_without_noise_nothing_happens_under_constant_light() -> None:
    model = PixelModel(noise_rms=0.0, theta_on=0.01, theta_off=0.01)
    for lux in (0.0, 1e-3, 10.0):
        assert len(events_of(model, light=LightHistory.constant(lux))) == 0


def test_without_noise_the_seed_does_not_matter() -> None:
    model = dataclasses.replace(BUSY, noise_rms=0.0)
    assert len(events_of(model)) > 100
    assert np.array_equal(events_of(model, seed=1), events_of(model, seed=2))


def test_a_slow_low_pass_does_not_stall() -> None:
    # At 0.5 Hz a sample moves the output by 3e-5 of its distance: single precision would stop far from the goal.
    model = PixelModel(noise_rms=0.0, corner_hz=0.5, theta_on=0.4999, theta_off=1.0, refractory_s=0.0)
    light = LightHistory(np.array([0.0, 0.1]), np.exp([0.0, 0.5]))
    events = events_of(model, light=light, roi=Roi(0, 0, 1, 1), duration_s=4.0)
    tau_s = 1.0 / (2.0 * math.pi * 0.5)
    assert len(events) == 1
    assert events["t"][0] * 1e-6 == pytest.approx(0.1 + tau_s * math.log(0.5 / 0.0001), abs=5e-5)


def test_an_empty_recording() -> None:
    assert len(events_of(BUSY, duration_s=0.0)) == 0
    assert len(events_of(BUSY, duration_s=1e-5)) == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"dt_s": 0.0}, "dt is 0.0 s"),
        ({"step": "heun"}, "expected exact or euler"),
        ({"threads": 0}, "0 threads"),
        ({"stretch_samples": 0}, "expected 1 or more"),
    ],
)
def test_nonsense_is_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ReferenceEngine(**arguments)


def test_the_euler_step_must_be_shorter_than_the_time_constant() -> None:
    fast = dataclasses.replace(BUSY, corner_hz=20_000.0)
    with pytest.raises(InputError, match="not below the time constant of 20000 Hz"):
        events_of(fast, step="euler")
    assert len(events_of(fast)) > 0


def test_the_share_of_the_processors_comes_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EVS_BENCH_THREADS", "3")
    assert processors() == 3
    monkeypatch.setenv("EVS_BENCH_THREADS", "many")
    with pytest.raises(InputError, match="EVS_BENCH_THREADS is 'many'; expected a number of threads, 1 or more"):
        processors()
