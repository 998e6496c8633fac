"""Each hook against a built-in effect that does the same, or against a closed form; hooks that do nothing."""

from __future__ import annotations

import functools
import math
import operator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import pytest
from scipy import optimize, stats

from drivers.events.types import EVENT_DTYPE
from protocols.errors import InputError
from protocols.points import Roi
from sim_backend.pixel import FastEngine, LightHistory, PixelModel, ReferenceEngine, build_chain
from sim_backend.pixel.effects import (
    ComparatorDelay,
    DarkCurrent,
    Effect,
    HighPass,
    HotPixels,
    InjectionOffset,
    Leak,
    LightDrift,
    LightFlicker,
    LowFrequencyNoise,
    ParasiticPhotocurrent,
    PhotoreceptorBandwidth,
    RefractoryMismatch,
    ResetNoise,
    ShotNoise,
    Stage,
    ThresholdMismatch,
    TimestampJitter,
)
from sim_backend.pixel.engines.lane_groups import needs_general
from sim_backend.pixel.hooks import COMPILED, HOOKS, has_hooks
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    import numpy.typing as npt

    Events = npt.NDArray[np.void]

DT_S = 1e-5
ROI = Roi(30, 40, 11, 13)  # 143 pixels: two whole groups of lanes and a part of one
ONE_PIXEL = Roi(0, 0, 1, 1)
STEPS = LightHistory(np.array([0.0, 0.01, 0.02, 0.0301, 0.045]), np.array([0.3, 0.9, 0.2, 4.0, 0.3]), nd_od=3.0)
BASE = PixelModel(noise_rms=0.09, corner_hz=300.0, theta_on=0.3, theta_off=0.25, refractory_s=2e-3)
QUIET = replace(BASE, noise_rms=0.0)
GAIN = BASE.photoconversion.gain_fa_per_lux
FULL = functools.reduce(
    operator.add,
    [
        LightFlicker(depth=0.05, frequency_hz=180.0, phase=1.0),
        DarkCurrent(mean_fa=5.0, spread=0.4),
        ShotNoise(factor=2.0),
        PhotoreceptorBandwidth(hz_per_fa=20.0, max_hz=900.0),
        LowFrequencyNoise(rms=0.05, tau_s=0.01),
        HighPass(corner_hz=20.0),
        Leak(rate_per_s=2.0, spread=0.3),
        ParasiticPhotocurrent(rate_per_s_per_lux=1.0),
        ResetNoise(rms=0.05),
        InjectionOffset(offset=0.02),
        ThresholdMismatch(),
        ComparatorDelay(delay_s=3.4e-5),
        RefractoryMismatch(spread=0.2),
        HotPixels(fraction=0.05, rate_hz=100.0),
        TimestampJitter(sigma_s=2e-5),
    ],
    BASE,
)


@dataclass(frozen=True, slots=True)
class Idle(Effect):
    """Every hook is there, and returns what it is given."""

    id: ClassVar[str] = "idle"
    stage: ClassVar[Stage] = "light"

    size: float = parameter("1", (0.0, 1.0), 0.0, 0.0, "how far it is from doing nothing")

    def light(self, lux, t_s):  # type: ignore[no-untyped-def]
        return lux * (1.0 + self.size * t_s)

    def response(self, u, current_fa):  # type: ignore[no-untyped-def]
        return u + self.size * current_fa

    def receptor_hz(self, corner_hz, current_fa):  # type: ignore[no-untyped-def]
        return corner_hz + self.size

    def noise_rms(self, rms, current_fa):  # type: ignore[no-untyped-def]
        return rms + self.size

    def leak(self, rate_per_s, current_fa):  # type: ignore[no-untyped-def]
        return rate_per_s + self.size

    def thresholds(self, on, off, current_fa, since_s, z):  # type: ignore[no-untyped-def]
        return on + self.size * z, off + self.size * since_s

    def refractory(self, period_s, current_fa, z):  # type: ignore[no-untyped-def]
        return period_s + self.size * z * z

    def events(self, events, draws, memory):  # type: ignore[no-untyped-def]
        return events[draws.uniform(events, "idle.lost") >= self.size]


def effect(hook: str, function: Any, effect_id: str = "mine", stage: Stage = "light", **fields: Any) -> Effect:
    """Return an effect with one hook, and with `fields` as parameters."""
    body: dict[str, Any] = {"id": effect_id, "stage": stage, "__annotations__": dict.fromkeys(fields, "float")}
    body |= {name: parameter("1", (-math.inf, math.inf), value, None, "") for name, value in fields.items()}
    function.__name__ = hook
    cls: Any = type("Mine", (Effect,), {**body, hook: function})
    made: Effect = dataclass(frozen=True)(cls)()
    return made


def recorded(model: PixelModel, light: LightHistory, duration_s: float, roi: Roi = ROI, **engine: Any) -> Events:
    """Return the events of a recording."""
    chain = build_chain(model, roi, sensor_seed=5)
    parts = ReferenceEngine(dt_s=DT_S, **engine).events(chain, light, duration_s, 3)
    return np.concatenate([np.empty(0, EVENT_DTYPE), *parts])


def intervals_s(model: PixelModel, current_fa: float, duration_s: float, roi: Roi = ONE_PIXEL) -> Any:
    """Return the intervals between events that follow each other in a pixel, at a constant photocurrent."""
    events = recorded(model, LightHistory.constant(current_fa / GAIN), duration_s, roi)
    pixels = events["y"].astype(int) * 4096 + events["x"]
    order = np.lexsort((events["t"], pixels))
    return np.diff(events["t"][order])[np.diff(pixels[order]) == 0] * 1e-6


def test_an_effect_has_the_hooks_that_it_overrides() -> None:
    assert Idle.hooks() == HOOKS
    assert Leak.hooks() == ()
    chain = build_chain(BASE + effect("light", drift), ROI, 1)
    assert has_hooks(chain)
    assert not chain.hooks.compiled
    assert not needs_general(chain)
    plain = build_chain(BASE + LightDrift(), ROI, 1)
    assert not has_hooks(plain)
    for hook in COMPILED:
        assert needs_general(build_chain(BASE + effect(hook, getattr(Idle, hook)), ROI, 1))


@pytest.mark.parametrize("step", ["exact", "euler"])
@pytest.mark.parametrize("model", [BASE, FULL], ids=["base", "full"])
def test_hooks_that_do_nothing_change_no_event(model: PixelModel, step: str) -> None:
    expected = recorded(model, STEPS, 0.06, step=step)
    assert len(expected) > 1000
    assert np.array_equal(recorded(model + Idle.null(), STEPS, 0.06, step=step), expected)


def test_hooks_that_do_something_change_events() -> None:
    """Else the test above could not fail."""
    assert not np.array_equal(recorded(FULL + Idle(size=1e-3), STEPS, 0.06), recorded(FULL, STEPS, 0.06))


@pytest.mark.parametrize("stretch_samples", [999, 100_000])
def test_threads_stretches_and_window_change_nothing(stretch_samples: int) -> None:
    model = FULL + Idle(size=1e-3)
    expected = recorded(model, STEPS, 0.06, threads=1)
    assert np.array_equal(recorded(model, STEPS, 0.06, threads=3, stretch_samples=stretch_samples), expected)
    inner = Roi(33, 42, 5, 6)
    x, y = expected["x"], expected["y"]
    inside = (x >= 33) & (x < 38) & (y >= 42) & (y < 48)
    assert np.array_equal(recorded(model, STEPS, 0.06, roi=inner), expected[inside])


@pytest.mark.parametrize("hook", HOOKS)
def test_the_fast_engine_hands_pixels_with_hooks_over(hook: str) -> None:
    chain = build_chain(BASE + effect(hook, getattr(Idle, hook), size=1e-3), ROI, 5)
    fast, reference = (list(e.events(chain, STEPS, 0.06, 3)) for e in (FastEngine(dt_s=DT_S), ReferenceEngine(DT_S)))
    assert len(np.concatenate(fast)) > 1000
    assert np.array_equal(np.concatenate(fast), np.concatenate(reference))


def drift(self, lux, t_s):  # type: ignore[no-untyped-def]
    return lux * (1.0 + 0.5 * t_s)


def with_dark_current(self, u, current_fa):  # type: ignore[no-untyped-def]
    return math.log(current_fa + 5.0)


def in_proportion(self, corner_hz, current_fa):  # type: ignore[no-untyped-def]
    return min(20.0 * current_fa, 900.0)


def leaking_in_proportion(self, rate_per_s, current_fa):  # type: ignore[no-untyped-def]
    return rate_per_s + self.rate * current_fa


@pytest.mark.parametrize(
    ("mine", "built_in"),
    [
        (effect("light", drift), LightDrift(rate_per_s=0.5)),
        (effect("response", with_dark_current), DarkCurrent(mean_fa=5.0, spread=0.0)),
        (effect("receptor_hz", in_proportion), PhotoreceptorBandwidth(hz_per_fa=20.0, max_hz=900.0)),
        (
            effect("leak", leaking_in_proportion, rate=3.0 / GAIN),
            ParasiticPhotocurrent(rate_per_s_per_lux=3.0),
        ),
    ],
    ids=["light", "response", "receptor_hz", "leak"],
)
def test_a_hook_does_what_a_built_in_effect_does(mine: Effect, built_in: Effect) -> None:
    expected = recorded(BASE + built_in, STEPS, 0.06)
    assert not np.array_equal(expected, recorded(BASE, STEPS, 0.06))
    assert np.array_equal(recorded(BASE + mine, STEPS, 0.06), expected)


def noise_of_the_light(self, rms, current_fa):  # type: ignore[no-untyped-def]
    return self.rms * math.sqrt(20.0 / current_fa)


@pytest.mark.parametrize("current_fa", [20.0, 30.0])
def test_noise_that_follows_the_light(current_fa: float) -> None:
    light = LightHistory.constant(current_fa / GAIN)
    expected = recorded(replace(BASE, noise_rms=0.1 * math.sqrt(20.0 / current_fa)), light, 0.1)
    assert len(expected) > 100
    assert np.array_equal(recorded(QUIET + effect("noise_rms", noise_of_the_light, rms=0.1), light, 0.1), expected)


def relaxing(self, on, off, current_fa, since_s, z):  # type: ignore[no-untyped-def]
    return on * (1.0 + self.size * math.exp(-since_s / self.tau_s)), off


def test_thresholds_that_relax_after_a_reset() -> None:
    """A leak of rate r crosses a threshold ``theta (1 + a exp(-t / tau))`` where both are equal."""
    model = QUIET + Leak(rate_per_s=3.0) + effect("thresholds", relaxing, size=2.0, tau_s=0.1)
    crossing = optimize.brentq(lambda t: 3.0 * t - 0.3 * (1.0 + 2.0 * math.exp(-t / 0.1)), 0.0, 1.0)
    assert intervals_s(model, 20.0, 1.0) == pytest.approx(crossing + 2e-3, abs=2 * DT_S)


def scattered(self, on, off, current_fa, since_s, z):  # type: ignore[no-untyped-def]
    return on + 0.03 * z, off


def test_thresholds_that_are_drawn_at_each_reset() -> None:
    """A leak of rate r makes intervals of ``(theta + s z) / r``, normal, one number for each reset."""
    model = replace(QUIET, refractory_s=0.0) + Leak(rate_per_s=30.0) + effect("thresholds", scattered)
    found = intervals_s(model, 20.0, 0.3, Roi(0, 0, 8, 8))
    assert len(found) > 1500
    assert stats.kstest(found + _within_a_sample(found), "norm", (0.01, 1e-3)).pvalue > 1e-3


def _within_a_sample(found: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return what takes the steps of a sample out of times, for a test of a continuous distribution."""
    return np.random.default_rng(1).uniform(-DT_S / 2, DT_S / 2, len(found))


def light_dependent(self, period_s, current_fa, z):  # type: ignore[no-untyped-def]
    return period_s * (1.0 + self.half_fa / current_fa)


def log_normal(self, period_s, current_fa, z):  # type: ignore[no-untyped-def]
    return period_s * math.exp(0.3 * z)


@pytest.mark.parametrize("current_fa", [2.0, 10.0, 100.0])
def test_a_dead_time_that_follows_the_light(current_fa: float) -> None:
    model = QUIET + Leak(rate_per_s=3.0) + effect("refractory", light_dependent, half_fa=10.0)
    assert intervals_s(model, current_fa, 1.0) == pytest.approx(0.1 + 2e-3 * (1.0 + 10.0 / current_fa), abs=2 * DT_S)


def test_a_dead_time_that_is_drawn_for_each_event() -> None:
    model = QUIET + Leak(rate_per_s=300.0) + effect("refractory", log_normal)
    found = intervals_s(model, 20.0, 0.2, Roi(0, 0, 8, 8)) - 1e-3
    assert len(found) > 3000
    z = np.log((found + _within_a_sample(found)) / 2e-3) / 0.3
    assert stats.kstest(z, "norm").pvalue > 1e-3


def longer(self, period_s, current_fa, z):  # type: ignore[no-untyped-def]
    return period_s + 1e-3


def twice(self, period_s, current_fa, z):  # type: ignore[no-untyped-def]
    return period_s * self.factor


def higher(self, on, off, current_fa, since_s, z):  # type: ignore[no-untyped-def]
    return on + 0.15, off


def scaled(self, on, off, current_fa, since_s, z):  # type: ignore[no-untyped-def]
    return on * self.factor, off * self.factor


def test_several_effects_act_one_after_the_other() -> None:
    """In the order of their stages and names: first longer by 1 ms, then twice as long; thresholds alike."""
    model = QUIET + Leak(rate_per_s=3.0)
    model += effect("refractory", twice, "b", factor=2.0)
    model += effect("refractory", longer, "a")
    model += effect("thresholds", higher, "c")
    model += effect("thresholds", scaled, "d", factor=2.0)
    expected = (0.3 + 0.15) * 2.0 / 3.0 + (2e-3 + 1e-3) * 2.0
    assert intervals_s(model, 20.0, 1.0) == pytest.approx(expected, abs=2 * DT_S)


def lost(self, events, draws, memory):  # type: ignore[no-untyped-def]
    return events[draws.uniform(events, "mine.lost") >= 0.25]


def every_second(self, events, draws, memory):  # type: ignore[no-untyped-def]
    keep = np.zeros(len(events), bool)
    for i, (x, y) in enumerate(zip(events["x"].tolist(), events["y"].tolist(), strict=True)):
        memory[x, y] = not memory.get((x, y), False)
        keep[i] = not memory[x, y]
    return events[keep]


def late(self, events, draws, memory):  # type: ignore[no-untyped-def]
    events["t_us"] += 3000.0 * draws.uniform(events, "mine.late")
    return events


def test_events_may_get_lost() -> None:
    before, after = recorded(BASE, STEPS, 0.06), recorded(BASE + effect("events", lost), STEPS, 0.06)
    assert np.all(np.isin(after, before))
    assert stats.binomtest(len(after), len(before), 0.75).pvalue > 1e-3


@pytest.mark.parametrize("stretch_samples", [500, 100_000])
def test_events_may_be_remembered(stretch_samples: int) -> None:
    before = recorded(BASE, STEPS, 0.06)
    after = recorded(BASE + effect("events", every_second), STEPS, 0.06, stretch_samples=stretch_samples)
    number = np.zeros(len(before), int)
    for pixel in set(zip(before["x"].tolist(), before["y"].tolist(), strict=True)):
        mine = (before["x"] == pixel[0]) & (before["y"] == pixel[1])
        number[mine] = np.arange(mine.sum())
    assert np.array_equal(after, before[number % 2 == 1])


@pytest.mark.parametrize("stretch_samples", [500, 100_000])
def test_events_may_be_late(stretch_samples: int) -> None:
    expected = recorded(BASE + effect("events", late), STEPS, 0.06)
    assert np.all(np.diff(expected["t"]) >= 0)
    assert np.array_equal(
        recorded(BASE + effect("events", late), STEPS, 0.06, stretch_samples=stretch_samples), expected
    )


def negative(self, lux, t_s):  # type: ignore[no-untyped-def]
    return lux - 1.0


def too_few(self, lux, t_s):  # type: ignore[no-untyped-def]
    return lux[:-1]


def broken(self, lux, t_s):  # type: ignore[no-untyped-def]
    return lux / {"factor": 2.0}["scale"]


def no_number(self, value, current_fa):  # type: ignore[no-untyped-def]
    return math.nan


def minus(self, value, *rest):  # type: ignore[no-untyped-def]
    return -1.0


def no_dead_time(self, period_s, current_fa, z):  # type: ignore[no-untyped-def]
    return -1.0 if current_fa > 30.0 else period_s


def no_threshold(self, on, off, current_fa, since_s, z):  # type: ignore[no-untyped-def]
    return on, off - 10.0 * since_s


def very_fast(self, corner_hz, current_fa):  # type: ignore[no-untyped-def]
    return 2e4


def listed(self, events, draws, memory):  # type: ignore[no-untyped-def]
    return list(events)


def early(self, events, draws, memory):  # type: ignore[no-untyped-def]
    events["t_us"] -= 5000.0
    return events


@pytest.mark.parametrize(
    ("hook", "function", "message"),
    [
        ("light", negative, r"light gave -0\.7 lux at 0 s; expected 0 lux or more"),
        ("light", too_few, r"light gave an array of float64, shape \(0,\); expected numbers of lux, shape \(1,\)"),
        ("light", broken, r"test_hooks\.py:\d+: KeyError: 'scale'"),
        ("response", no_number, r"response gave nan at a photocurrent of .* fA; expected a finite number"),
        ("receptor_hz", minus, r"receptor_hz gave -1 at .* expected more than 1e-06 Hz"),
        ("noise_rms", minus, r"noise_rms gave -1 at .* expected 0 or more, ln units"),
        ("leak", no_number, r"leak gave nan at .* expected a finite number, ln units per s"),
        ("thresholds", no_threshold, r"thresholds gave 0 at .* expected more than 0, ln units"),
        ("refractory", no_dead_time, r"test_hooks\.py:\d+: .* refractory gave -1 at .* expected 0 to 1e\+09 s"),
        ("events", listed, r"events gave a list; expected an array of events"),
        ("events", early, r"events gave an event at -?\d+ us; expected none before \d+ us"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_named(hook: str, function: Any, message: str) -> None:
    model = replace(QUIET, theta_on=0.2) + effect(hook, function)
    with pytest.raises(InputError, match=message) as error:
        recorded(model, LightHistory(STEPS.t_s * 4, STEPS.lux), 0.24, Roi(0, 0, 1, 1), stretch_samples=1000)
    assert "\n" not in str(error.value)


def test_the_euler_step_is_too_long_for_a_fast_photoreceptor() -> None:
    model = QUIET + effect("receptor_hz", very_fast)
    with pytest.raises(InputError, match=r"not below the time constant of the photoreceptor, 20000 Hz at"):
        recorded(model, STEPS, 0.06, step="euler")
