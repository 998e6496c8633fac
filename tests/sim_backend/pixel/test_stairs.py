"""Quiet pixels jump through low stairs of light: their tables, and their events beside those of all samples."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2

from protocols.points import Roi
from sim_backend.pixel import FastEngine, LightHistory, PixelModel, ReferenceEngine, build_chain
from sim_backend.pixel.effects.registry import effect_from_dict
from sim_backend.pixel.engines import one_pole
from sim_backend.pixel.engines.segments import LAST, Segments
from sim_backend.pixel.engines.stairs import no_stairs, stairs_of

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

DT_S = 1e-5
RATE, RMS = 0.01, 0.04
HZ = 100.0
EIGHTHS = 8
#: Squares of differences of so many counts, beside their variance, are larger once in 10 000 times.
LIMIT = chi2.ppf(1.0 - 1e-4, EIGHTHS)
STEPPED = FastEngine(DT_S, threads=1, stepped_light=True)
CONSTANT = LightHistory(np.array([0.0]), np.array([5.0]))


def staircase(edge: float = 0.0) -> Segments:
    """Return 100 stairs of 64 samples that go up and down; from the middle on, `edge` higher in ln units."""
    height = 0.05 * np.sin(0.9 * np.arange(100)) + edge * (np.arange(100) >= 50)
    first = np.append(1 + 64 * np.arange(100), LAST)
    return Segments(first, first[:-1] - 1, 2.0 * np.exp(height))


@pytest.mark.parametrize("dark_lux", [0.0, 3.0])
def test_the_response_is_that_of_the_low_pass(dark_lux: float) -> None:
    light = staircase(0.4)
    tables, _, window, _ = stairs_of(light, 2.0, np.array([dark_lux]), 1e-9, RATE, RMS)
    levels = np.log((np.repeat(light.lux, 64) + dark_lux) / (2.0 + dark_lux)) / RMS
    response = np.concatenate([[0.0], lfilter([-np.expm1(-RATE)], [1.0, -np.exp(-RATE)], levels)])
    begin = np.arange(100) * 64
    assert tables[0, 0] == pytest.approx(response[begin], abs=1e-9)
    assert tables[1, 0] == pytest.approx(response[begin] - levels[begin], abs=1e-9)
    for s in np.flatnonzero(window < LAST - 1):
        seen = response[begin[s] : window[s] + 1]
        assert tables[3, 0, s] <= np.min(seen) + 1e-9
        assert tables[2, 0, s] >= np.max(seen) - 1e-9
        assert tables[2, 0, s] - tables[3, 0, s] <= np.ptp(seen) + 1e-9


def test_stairs_are_low_again_when_the_response_to_an_edge_is() -> None:
    _, fastest, window, since = stairs_of(staircase(0.4), 2.0, np.zeros(1), 1e-9, RATE, RMS)
    assert np.all(since[:50] == 0)
    high = (since == LAST).nonzero()[0]
    assert list(high) == list(range(50, 50 + len(high)))
    # The edge is 10 rms, of which exp(-0.64) are left after each stair, beside those of some rms.
    assert 2 <= len(high) <= 5
    assert np.all(since[high[-1] + 1 :] == 64 * (high[-1] + 1))
    assert np.all(window[:50] <= 64 * 50)  # none leads to an edge
    assert np.all(fastest[:50] <= 2.0)


@pytest.mark.parametrize(
    ("depth", "hz", "theta", "extra"),
    [
        (0.03, 100.0, 0.17, {}),
        (0.04, 333.0, 0.18, {}),
        (0.03, 100.0, 0.18, {"leak": {"rate_per_s": 0.1}}),
        (0.06, 100.0, 0.17, {"dark_current": {"mean_fa": 5.0, "spread": 0.5}}),
    ],
)
def test_first_events_come_at_the_phases_at_which_they_come_stair_by_stair(
    depth: float, hz: float, theta: float, extra: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    model = flickering(depth, hz, theta)
    for name, values in extra.items():
        model += effect_from_dict(name, values)
    here = phases(STEPPED, model, hz, range(100, 120))
    monkeypatch.setattr(one_pole, "stairs_of", lambda *_: no_stairs())
    there = phases(STEPPED, model, hz, range(20))
    assert np.sum(there) > 3000
    assert differ(here, there) < LIMIT


def test_first_events_come_at_the_phases_of_the_reference_engine() -> None:
    model = flickering(0.03, HZ, 0.17)
    here = phases(STEPPED, model, HZ, range(100, 110))
    there = phases(ReferenceEngine(DT_S, threads=1), model, HZ, range(10))
    assert np.sum(there) > 1000
    assert differ(here, there) < LIMIT


def flickering(depth: float, hz: float, theta: float) -> PixelModel:
    model = PixelModel(theta_on=theta, theta_off=0.6, noise_rms=0.04, corner_hz=170.0, refractory_s=1.0)
    return model + effect_from_dict("light_flicker", {"depth": depth, "frequency_hz": hz, "phase": 0.3})


def phases(engine: FastEngine | ReferenceEngine, model: PixelModel, hz: float, seeds: range) -> Floats:
    """Return how many events come in each eighth of a period."""
    found = np.zeros(EIGHTHS)
    for seed in seeds:
        chain = build_chain(model, Roi(0, 0, 48, 48), seed)
        events = np.concatenate(list(engine.events(chain, CONSTANT, 0.3, seed)))
        found += np.bincount((events["t"] * 1e-6 * hz * EIGHTHS).astype(int) % EIGHTHS, minlength=EIGHTHS)
    return found


def differ(here: Floats, there: Floats) -> float:
    return float(np.sum((here - there) ** 2 / (here + there)))


def test_jumps_are_taken_and_save_most_of_the_random_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    model = PixelModel(noise_rms=0.04) + effect_from_dict("light_flicker", {"depth": 0.03, "frequency_hz": HZ})
    through = counters(model)
    monkeypatch.setattr(one_pole, "stairs_of", lambda *_: no_stairs())
    assert through < 0.3 * counters(model)


def counters(model: PixelModel) -> int:
    from sim_backend.pixel.engines import fast_kernels as k
    from sim_backend.pixel.engines.stepped_light import with_stairs

    chain, light = with_stairs(build_chain(model, Roi(0, 0, 8, 8), 1), CONSTANT, DT_S, 1, 1.0)
    walk = one_pole.OnePole(chain, light, DT_S, 1, in_stairs=True)
    walk.advance(slice(0, 64), 100_000)
    return int(np.sum(walk._state[0][:, k.COUNTER]))


def test_events_of_a_pixel_do_not_depend_on_others_or_on_how_often_they_are_handed_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model = PixelModel(theta_on=0.2, theta_off=0.2, noise_rms=0.04)
    model += effect_from_dict("light_flicker", {"depth": 0.03, "frequency_hz": HZ})
    model += effect_from_dict("dark_current", {"mean_fa": 5.0, "spread": 0.5})

    def events(roi: Roi) -> npt.NDArray[np.void]:
        found = np.concatenate(list(STEPPED.events(build_chain(model, roi, 1), CONSTANT, 3.0, 1)))
        return found[(found["x"] >= 2) & (found["x"] < 4) & (found["y"] < 3)]

    whole = events(Roi(0, 0, 12, 12))
    assert len(whole) > 10
    assert np.array_equal(whole, events(Roi(2, 0, 2, 3)))
    monkeypatch.setattr(one_pole, "_STRETCH_SAMPLES", 16384)
    assert np.array_equal(whole, events(Roi(0, 0, 12, 12)))
