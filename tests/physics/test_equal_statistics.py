"""Both engines have one distribution of events; and the judge of that finds small errors, and none where none is.

This is the quick part: ``make verify`` compares all settings at 1e5 pulses each.
"""

from __future__ import annotations

import dataclasses
import itertools
from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy.stats import binom

from protocols.points import Roi
from sim_backend.pixel import FastEngine, ReferenceEngine
from sim_backend.pixel.effects import effects
from sim_backend.pixel.engines.compare import p_values
from sim_backend.pixel.engines.settings import SETTINGS, setting
from sim_backend.pixel.engines.sign_flips import holm, sign_flip_p_values

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from sim_backend.pixel import PixelModel

ROI = Roi(0, 0, 16, 16)
FAMILY_LEVEL = 1e-3
#: Where the engines differ most in how they work.
QUICK = (
    "2 kHz, 0.1 ms", "200 Hz, reset/test", "200 Hz, constant", "rise 0.1 ms", "leak", "reset noise", "flicker",
    "two poles, low light", "default station",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", QUICK)
def test_both_engines_have_one_distribution_of_events(name: str) -> None:
    one = setting(name)
    pulses = one.pulses(ROI, 2500 * 0.2)
    pair = [one.events(e, pulses, seed) for e, seed in ((ReferenceEngine(), 1), (FastEngine(), 2))]
    assert len(pair[0]) > 100
    found = p_values(pair[0], pair[1], pulses)
    assert min(found.values()) > FAMILY_LEVEL / (len(QUICK) * len(found)), found


@pytest.mark.slow
def test_noise_in_the_memory_of_a_slow_high_pass_is_not_missed() -> None:
    one = setting("high-pass")
    quiet = FastEngine(quiet_high_pass=0.01)
    pulses = one.pulses(ROI, 2500 * 0.2)
    pair = [one.events(e, pulses, seed) for e, seed in ((ReferenceEngine(), 1), (quiet, 2))]
    found = p_values(pair[0], pair[1], pulses)
    assert min(found.values()) > FAMILY_LEVEL / len(found), found
    faster = dataclasses.replace(quiet, quiet_high_pass=1e-4)  # the corner is above it: left to the reference engine
    assert np.array_equal(one.events(faster, pulses, 1), pair[0])


def wrong_threshold(model: PixelModel) -> PixelModel:
    return dataclasses.replace(model, theta_on=1.01 * model.theta_on, theta_off=1.01 * model.theta_off)


def wrong_dead_time(model: PixelModel) -> PixelModel:
    return dataclasses.replace(model, refractory_s=1.1 * model.refractory_s)


def wrong_noise(model: PixelModel) -> PixelModel:
    return dataclasses.replace(model, noise_rms=1.01 * model.noise_rms)


def wrong_corner(model: PixelModel) -> PixelModel:
    return dataclasses.replace(model, corner_hz=1.02 * model.corner_hz)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "error"),
    [
        ("200 Hz, 10 ms", wrong_threshold),
        ("2 kHz, constant", wrong_threshold),
        ("200 Hz, 10 ms", wrong_dead_time),
        ("2 kHz, 0.1 ms", wrong_dead_time),
        ("200 Hz, reset/test", wrong_noise),
        ("5 Hz, large step", wrong_corner),
    ],
)
def test_an_engine_that_is_a_little_wrong_is_caught(name: str, error: Callable[[PixelModel], PixelModel]) -> None:
    """At 1e5 pulses, as ``make verify`` takes them, and after correction for all its tests."""
    right = setting(name)
    wrong = dataclasses.replace(right, model=error(right.model))
    pulses = right.pulses(Roi(0, 0, 32, 32), 1e5 * 0.2)
    pair = [s.events(FastEngine(), pulses, seed) for s, seed in ((right, 1), (wrong, 2))]
    found = p_values(pair[0], pair[1], pulses)
    assert min(found.values()) * len(found) * len(SETTINGS) < 0.01, found


@pytest.mark.slow
def test_equal_engines_are_not_told_apart_more_often_than_the_p_values_say() -> None:
    one, repeats, level = setting("200 Hz, 0.1 ms"), 80, 0.1
    pulses = one.pulses(Roi(0, 0, 8, 8), 64 * 2.0)
    recordings = [one.events(FastEngine(threads=1), pulses, seed) for seed in range(2 * repeats)]
    found = [p_values(a, b, pulses) for a, b in zip(recordings[::2], recordings[1::2], strict=True)]
    for name in found[0]:
        small = sum(p[name] <= level for p in found)
        # Few events of a kind have few p-values: these may be too large, never too small.
        assert binom.sf(small - 1, repeats, level) > FAMILY_LEVEL / len(found[0]), name


@pytest.mark.parametrize("columns", [1, 3])
def test_choices_of_signs_are_counted_as_when_all_are_tried(columns: int) -> None:
    differences = np.random.default_rng(columns).normal(0.6, 1.0, (12, columns))
    unit = differences / np.sqrt(np.sum(differences**2, axis=0))
    every = np.array(list(itertools.product([-1.0, 1.0], repeat=12)))
    exact = float(np.mean(np.abs(every @ unit).max(axis=1) >= np.abs(unit.sum(axis=0)).max() - 1e-9))
    found = sign_flip_p_values({"a": differences})["a"]
    draws = 2000 if exact > 0.01 else 200_000
    assert found == pytest.approx(exact, abs=5.0 * np.sqrt(exact / draws) + 1.0 / draws)


def test_what_is_too_rare_to_be_counted_has_a_bound() -> None:
    sure: npt.NDArray[np.float64] = np.ones((100, 1))
    found = sign_flip_p_values({"sure": sure, "none": np.zeros((100, 2))})
    assert 2.0**-99 <= found["sure"] < 1e-20
    assert found["none"] == 1.0


def test_the_smallest_p_value_is_multiplied_by_the_number_of_all() -> None:
    # S. Holm's procedure by hand: 4 * 0.01, 3 * 0.02, 2 * 0.03 and 1 * 0.02, none below the one before.
    found = {"a": 0.03, "b": 0.01, "c": 0.04, "d": 0.02}
    assert holm(found) == pytest.approx({"b": 0.04, "d": 0.06, "a": 0.06, "c": 0.06})


def test_the_table_covers_what_the_engines_can_do() -> None:
    assert len(SETTINGS) >= 24
    assert len({s.name for s in SETTINGS}) == len({s.purpose for s in SETTINGS}) == len(SETTINGS)
    assert {s.model.corner_hz for s in SETTINGS} >= {5.0, 50.0, 200.0, 2000.0}
    assert {s.stimulus.kind for s in SETTINGS} == {"square", "reset and test", "constant"}
    covered = {e.id for s in SETTINGS for e in s.model.effects}
    # These make all pixels of a window depend on each other; both engines hand their events to one and the same code.
    assert set(effects()) - covered == {"readout_saturation", "trail_filter", "event_rate_limit"}
