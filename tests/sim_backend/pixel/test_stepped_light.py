"""Light in stairs beside the light itself, and events beside those of the reference engine."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from protocols.points import Roi
from sim_backend.pixel import FastEngine, LightHistory, PixelModel, ReferenceEngine, build_chain
from sim_backend.pixel.effects.registry import effect_from_dict
from sim_backend.pixel.engines.stepped_light import cut_for_memory, memory_slopes, with_stairs
from sim_backend.pixel.light_path import ChipLight

DT_S = 1e-5
ROI = Roi(0, 0, 10, 10)
PLAIN = build_chain(PixelModel(), ROI, 0)
SQUARE = LightHistory(0.05 * np.arange(20, dtype=np.float64), 2.0 * np.exp(0.4 * (np.arange(20) % 2)), room_lux=0.1)
SECONDS = 1.0
#: Then nothing happens for a long time.
LONG = LightHistory(np.array([0.0, 0.1]), np.array([1.0, 3.0]))
#: Contrasts just below the threshold.
NEAR = LightHistory(0.05 * np.arange(20, dtype=np.float64), np.exp(0.27 * (np.arange(20) % 2)))
#: Squares of differences of two counts, beside their variance, are 1 on average; so many standard errors of that.
SURE = 5.0


def both(**changes: Any) -> tuple[np.ndarray, np.ndarray, LightHistory]:
    """Return the light at all samples, that in stairs, and the stairs."""
    chain = dataclasses.replace(PLAIN, **changes)
    steady, stairs = with_stairs(chain, SQUARE, DT_S, 1, SECONDS)
    samples = round(SECONDS / DT_S)
    return (
        ChipLight(chain, SQUARE, DT_S, 1).lux(0, samples),
        ChipLight(steady, stairs, DT_S, 1).lux(0, samples),
        stairs,
    )


@pytest.mark.parametrize("depth", [0.02, 0.1])
@pytest.mark.parametrize("hz", [47.0, 100.0, 333.0])
@pytest.mark.parametrize("phase", [None, 0.7])
def test_flicker_in_stairs_has_its_depth_frequency_and_phase(hz: float, phase: float | None, depth: float) -> None:
    there, stairs, history = both(flicker_depth=depth, flicker_hz=hz, flicker_phase=phase)
    source = ChipLight(PLAIN, SQUARE, DT_S, 1).lux(0, len(there)) - 0.1
    wave = np.exp(2j * math.pi * hz * DT_S * np.arange(len(there)))
    exact, stepped = (np.mean(((x - 0.1) / source - 1.0) * wave.conj()) for x in (there, stairs))
    # Phases are cut in 64 parts, which loses 0.04 %, and times in whole samples; the rest comes from the stimulus.
    assert abs(stepped) == pytest.approx(abs(exact), rel=2e-3)
    assert abs(np.angle(stepped / exact)) < 2.0 * math.pi * hz * DT_S
    assert np.max(np.abs(stairs - there) / source) < 0.5 * depth
    assert np.mean(stairs) == pytest.approx(np.mean(there), rel=1e-3)
    assert len(np.unique(history.lux)) <= 2 * 32 + 1  # laws that have to be worked out


@pytest.mark.parametrize("settled_hz", [math.inf, 150.0])
def test_pixels_memorise_the_light_of_the_start_and_not_of_the_first_stair(settled_hz: float) -> None:
    """A stair is away from it by up to two fifths of the depth; events of slow pixels keep that for long."""
    there, stairs, _ = both(flicker_depth=0.1, flicker_hz=100.0, flicker_phase=0.3, flicker_settled_hz=settled_hz)
    assert stairs[0] == there[0]
    assert abs(stairs[1] - there[1]) > 0.01 * there[1]


@pytest.mark.parametrize("rate", [0.3, -0.3, -1.6])
def test_drift_in_stairs_is_never_far_away(rate: float) -> None:
    there, stairs, _ = both(drift_per_s=rate)
    lit = there - 0.1 > 1e-3
    assert np.abs(np.log((stairs[lit] - 0.1) / (there[lit] - 0.1))).max() < 0.0026
    assert np.abs(stairs[~lit] - there[~lit]).max(initial=0.0) < 1e-3


def test_light_that_rests_or_rises_is_left_alone() -> None:
    assert with_stairs(PLAIN, SQUARE, DT_S, 1, SECONDS) == (PLAIN, SQUARE)
    rising = dataclasses.replace(PLAIN, drift_per_s=0.1, rise_tau_s=1e-3)
    assert with_stairs(rising, SQUARE, DT_S, 1, SECONDS) == (rising, SQUARE)


@pytest.mark.parametrize(("hz", "receptor_hz"), [(0.3, math.inf), (5.0, math.inf), (60.0, math.inf), (5.0, 3.0)])
@pytest.mark.parametrize("light", [SQUARE, LONG], ids=["square", "long"])
def test_what_a_high_pass_remembers_is_the_solution_of_its_equation(
    hz: float, receptor_hz: float, light: LightHistory
) -> None:
    corner_hz = 100.0
    chain = dataclasses.replace(PLAIN, high_pass_hz=hz, corner_hz=corner_hz, receptor_max_hz=receptor_hz)
    cut = cut_for_memory(chain, light, SECONDS)
    slopes = memory_slopes(chain, cut, DT_S, 1, SECONDS)
    ends = np.append(cut.t_s[1:], SECONDS)
    grown = np.cumsum(slopes * (ends - cut.t_s) / DT_S)
    w, c, r = (2.0 * math.pi * x for x in (hz, corner_hz, min(receptor_hz, 1e4)))
    lux = ChipLight(chain, light, DT_S, 1).settled_lux
    settled = np.log(chain.gain_fa_per_lux[0] * lux + chain.dark_fa[0])

    def slope(t: float, x: np.ndarray) -> list[float]:
        u = settled[np.searchsorted(light.t_s, t, side="right") - 1]
        return [r * (u - x[0]), c * (x[0] - x[1]), w * (x[1] - x[2])]

    at = np.unique(np.minimum(ends, SECONDS - 1e-9))
    start = [settled[0]] * 3
    found = solve_ivp(slope, (0.0, SECONDS), start, "LSODA", t_eval=at, max_step=1e-3, rtol=1e-7, atol=1e-9)
    # Parts are whole samples, in which it grows by w times a step of 1.1.
    assert grown[: len(at)] + settled[0] == pytest.approx(found.y[2], abs=1e-3 + 1.1 * w * DT_S)


FLICKER = {"light_flicker": {"depth": 0.2, "frequency_hz": 73.0}}
RECEPTOR = {"photoreceptor_bandwidth": {"hz_per_fa": 5.0}}


@pytest.mark.parametrize(
    ("effects", "lux"),
    [
        ({**FLICKER, **RECEPTOR}, 6.0),
        ({"light_drift": {"rate_per_s": -0.8}, "low_frequency_noise": {"rms": 0.04, "tau_s": 0.5}}, 2.0),
        ({"high_pass": {"corner_hz": 12.0}, "shot_noise": {"factor": 0.3}}, 2.0),
        ({"high_pass": {"corner_hz": 3.0}, **RECEPTOR}, 0.08),
        ({"high_pass": {"corner_hz": 9.0}, "low_frequency_noise": {"rms": 0.05, "tau_s": 0.1}}, 2.0),
        (FLICKER, 2.0),
        ({"light_drift": {"rate_per_s": 1.0}, "contrast_error": {"gain_error": -0.05}}, 2.0),
        ({"high_pass": {"corner_hz": 8.0}}, 2.0),
    ],
    ids=lambda e: "+".join(e) if isinstance(e, dict) else "",
)
def test_events_are_nearly_those_of_the_reference_engine(effects: dict[str, dict[str, float]], lux: float) -> None:
    """The first effect is the one in question: without it the counts are clearly others."""
    model = PixelModel(theta_on=0.3, theta_off=0.3, noise_rms=0.03, corner_hz=150.0, refractory_s=3e-3)
    with_all = model
    for number, (name, values) in enumerate(effects.items()):
        with_all = with_all + effect_from_dict(name, values)
        model = model + effect_from_dict(name, values) if number else model
    light = LightHistory(NEAR.t_s, lux * NEAR.lux)
    stepped = FastEngine(DT_S, threads=1, quiet_high_pass=1.0, stepped_light=True)
    here = counts(stepped, with_all, light)
    there = counts(ReferenceEngine(DT_S, threads=1), with_all, light)
    limit = 1.0 + SURE * math.sqrt(2.0 / here.size)
    assert apart(here, there) < limit
    assert apart(counts(FastEngine(DT_S, threads=1), model, light), there) > 1.5 * limit


def counts(engine: FastEngine | ReferenceEngine, model: PixelModel, light: LightHistory) -> np.ndarray:
    """Return the events of each polarity after each edge."""
    edges = np.append(light.t_s, SECONDS) * 1e6
    events = np.concatenate(list(engine.events(build_chain(model, ROI, 1), light, SECONDS, 3)))
    return np.stack([np.histogram(events["t"][events["p"] == p], edges)[0] for p in (0, 1)])


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """Return the mean square of the differences beside their variance, if counts were those of chance."""
    return float(np.mean((one - other) ** 2 / np.maximum(one + other, 1.0)))


@pytest.mark.parametrize("q", [0.05, 0.5, 1.0, 3.0])
def test_slow_noise_behind_a_high_pass_goes_as_far_as_its_law_says(q: float) -> None:
    """The mean square of its steps, from the spectrum, beside that of the exponential law in its place."""
    from sim_backend.pixel.engines.fast import _slow_share

    share = _slow_share(q)
    w = np.geomspace(1e-4, 1e4, 200_001)
    density = 2.0 / np.pi * w**2 / (w**2 + q**2) / (w**2 + 1.0)

    def steps(t: float) -> float:
        return float(np.trapezoid(density * (1.0 - np.cos(w * t)), w)) * 2.0

    for t in (0.01, 0.1, 0.3, 1.0, 2.0):
        mine = 2.0 * share * -np.expm1(-t / share)
        assert mine == pytest.approx(steps(t), rel=0.08), t
