"""The readout: each stage against its definition, and the same fate of events however they are cut into stretches."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from protocols.points import Roi
from sim_backend.pixel import PixelModel, build_chain
from sim_backend.pixel.effects import HotPixels
from sim_backend.pixel.engines.readout import TIMED_DTYPE, Readout, has_readout

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel import Chain

    Events = npt.NDArray[np.void]

ROI = Roi(10, 20, 40, 30)
DURATION_S = 1.0
PLAIN = build_chain(PixelModel(), ROI, 3)
ALL: dict[str, Any] = {
    "hot_hz": np.where(np.arange(PLAIN.pixels) % 7 == 0, 40.0, 0.0),
    "crosstalk": 0.3,
    "queue_eps": 5e4,
    "queue_events": 30.0,
    "jitter_s": 3e-5,
    "trail_s": 0.02,
    "limit_eps": 2e4,
    "limit_period_s": 1.1e-3,
    "comparator_delay_s": 1.7e-5,
}


def made(t_us: Any, x: Any = 15, y: Any = 25, p: Any = 1) -> Events:
    """Return events on their way."""
    events = np.empty(len(t_us), TIMED_DTYPE)
    events["t_us"], events["x"], events["y"], events["p"] = t_us, x, y, p
    return events


def scattered(n: int, seed: int = 1) -> Events:
    """Return n events anywhere in window and recording, on a grid of 10 us, so that many are at once."""
    rng = np.random.default_rng(seed)
    t_us = 10.0 * np.sort(rng.integers(0, round(DURATION_S * 1e5), n))
    x, y = rng.integers(ROI.x, ROI.x + ROI.width, n), rng.integers(ROI.y, ROI.y + ROI.height, n)
    return made(t_us, x, y, rng.integers(0, 2, n))


def read_out(events: Events, cuts_us: Any = (), seed: int = 1, chain: Chain = PLAIN, **changes: Any) -> Events:
    """Return the recording of these events, handed over in stretches."""
    readout = Readout(dataclasses.replace(chain, **changes), seed, DURATION_S)
    parts, begin_us = [], 0.0
    for end_us in [*cuts_us, math.inf]:
        inside = (events["t_us"] >= begin_us) & (events["t_us"] < end_us)
        parts.append(readout.take(events[inside], end_us))
        begin_us = end_us
    return np.concatenate(parts)


def test_a_plain_chain_has_no_readout_and_it_would_change_nothing() -> None:
    events = scattered(5000)
    assert not has_readout(PLAIN)
    same = read_out(events)
    assert np.array_equal(same["t"], events["t_us"])
    assert sorted(same.tolist()) == sorted((int(t), x, y, p) for t, x, y, p in events.tolist())


@pytest.mark.parametrize("name", ["all", *sorted({name.split("_")[0] for name in ALL})])
def test_stretches_change_nothing_and_events_come_in_order(name: str) -> None:
    changes = ALL if name == "all" else {k: v for k, v in ALL.items() if k.split("_")[0] == name}
    events = scattered(30_000)
    expected = read_out(events, **changes)
    assert has_readout(dataclasses.replace(PLAIN, **changes))
    assert np.array_equal(expected, np.sort(expected, order=["t", "y", "x", "p"]))
    assert len(expected) > 5000
    assert expected["t"].min() >= 0
    assert expected["t"].max() < DURATION_S * 1e6
    for cuts_us in (np.arange(10.0, 1e6, 7770.0), [333_333.3], [0.0, 1e6, 2e6]):
        assert np.array_equal(read_out(events, cuts_us, **changes), expected)


def test_memory_is_bounded() -> None:
    """Of a long recording only the last moments wait."""
    readout = Readout(dataclasses.replace(PLAIN, **ALL), 1, DURATION_S)
    events = scattered(30_000)
    passed = len(readout.take(events[events["t_us"] < 9e5], 9e5))
    rest = len(readout.take(events[events["t_us"] >= 9e5], math.inf))
    assert 0.1 * passed < rest < 0.13 * passed


# Queue


@pytest.mark.parametrize("n", [1, 7, 300])
def test_the_last_of_n_events_at_once_is_served_after_n_times_the_service(n: int) -> None:
    events = read_out(made(np.full(n, 1000.0), x=10 + np.arange(n) % 40, y=20 + np.arange(n) // 40), queue_eps=1e5)
    assert events["t"].tolist() == [1000 + 10 * (k + 1) for k in range(n)]
    assert np.array_equal(np.lexsort((events["x"], events["y"])), np.arange(n))


def test_what_finds_the_queue_full_is_lost() -> None:
    chain: dict[str, Any] = {"queue_eps": 1e5, "queue_events": 4.0}
    assert read_out(made(np.full(20, 1000.0)), **chain)["t"].tolist() == [1010, 1020, 1030, 1040]
    # At 1025 us two of the four have been served, so two more find room.
    later = made([1000.0] * 4 + [1025.0] * 5)
    assert read_out(later, **chain)["t"].tolist() == [1010, 1020, 1030, 1040, 1050, 1060]


@pytest.mark.effect("readout_saturation", shows="closed_form")
def test_the_queue_waits_as_the_theory_says() -> None:
    """Random arrivals, constant service (M/D/1): the mean wait is ``load / (2 (1 - load))`` services."""
    load, service_us = 0.6, 20.0
    rng = np.random.default_rng(4)
    t_us = np.cumsum(rng.exponential(service_us / load, 30_000))
    t_us = t_us[t_us < 9e5]
    wait = read_out(made(t_us), queue_eps=1e6 / service_us)["t"] - t_us - service_us
    batches = wait[: len(wait) // 50 * 50].reshape(50, -1).mean(axis=1)
    expected_us = service_us * load / (2.0 * (1.0 - load))
    assert wait.mean() == pytest.approx(expected_us, abs=4.0 * batches.std() / math.sqrt(50))
    assert batches.std() / math.sqrt(50) < 0.05 * expected_us


# Hot pixels


@pytest.mark.effect("hot_pixels", shows="closed_form")
def test_hot_pixels_are_a_fraction_and_fire_at_random() -> None:
    model = PixelModel() + HotPixels(fraction=0.02, rate_hz=60.0)
    chain = build_chain(model, Roi(0, 0, 200, 100), 9)
    hot = np.count_nonzero(chain.hot_hz)
    assert hot == pytest.approx(400, abs=4.0 * math.sqrt(400))
    assert set(chain.hot_hz) == {0.0, 60.0}
    events = read_out(made([]), chain=chain)
    assert np.all(events["p"] == 1)
    counts = np.bincount(events["y"].astype(int) * 200 + events["x"], minlength=20_000)
    assert np.all(counts[chain.hot_hz == 0.0] == 0)
    per_pixel = counts[chain.hot_hz > 0.0]
    assert per_pixel.sum() == pytest.approx(60.0 * hot, abs=4.0 * math.sqrt(60.0 * hot))
    dispersion = per_pixel.var(ddof=1) / per_pixel.mean()  # 1 for Poisson
    assert dispersion == pytest.approx(1.0, abs=4.0 * math.sqrt(2.0 / hot))
    assert np.mean(events["t"]) == pytest.approx(5e5, abs=4.0 * 2.9e5 / math.sqrt(len(events)))


def test_other_recordings_have_other_hot_events_of_the_same_pixels() -> None:
    chain = build_chain(PixelModel() + HotPixels(fraction=0.02, rate_hz=60.0), ROI, 9)
    one, two = (read_out(made([]), chain=chain, seed=s) for s in (1, 2))
    assert not np.array_equal(one["t"], two["t"])
    assert set(zip(one["x"], one["y"], strict=True)) == set(zip(two["x"], two["y"], strict=True))


# Crosstalk


@pytest.mark.effect("crosstalk", shows="closed_form")
def test_copies_lie_in_a_neighbour_within_10_us() -> None:
    n = 20_000
    t_us = 40.0 * np.arange(n)
    polarity = np.arange(n) % 2
    events = read_out(made(t_us, 20, 30, polarity), crosstalk=0.2)
    source = (events["x"] == 20) & (events["y"] == 30)
    assert np.array_equal(events["t"][source], t_us)
    copies = events[~source]
    assert len(copies) == pytest.approx(0.2 * n, abs=4.0 * math.sqrt(0.16 * n))
    assert np.all(copies["t"] % 40 <= 10)
    assert np.array_equal(copies["p"], copies["t"] // 40 % 2)
    where = {(21, 30): 0, (19, 30): 0, (20, 31): 0, (20, 29): 0}
    for x, y in zip(copies["x"], copies["y"], strict=True):
        where[int(x), int(y)] += 1
    assert list(where.values()) == pytest.approx([len(copies) / 4] * 4, abs=4.0 * math.sqrt(len(copies) * 3 / 16))


def test_copies_outside_the_window_are_lost() -> None:
    corner = read_out(made(40.0 * np.arange(10_000), 10, 20), crosstalk=1.0)
    copies = corner[(corner["x"] != 10) | (corner["y"] != 20)]
    assert {(int(x), int(y)) for x, y in zip(copies["x"], copies["y"], strict=True)} == {(11, 20), (10, 21)}
    assert len(copies) == pytest.approx(5000, abs=4.0 * 50.0)


# Jitter


def test_jitter_is_gaussian_and_events_are_sorted_again() -> None:
    t_us = 100.0 * np.arange(100, 9900)
    events = read_out(made(t_us, p=np.arange(len(t_us)) % 2), jitter_s=2e-5)
    error = events["t"] - 100.0 * np.rint(events["t"] / 100.0)
    n = len(error)
    assert n == len(t_us)
    assert error.mean() == pytest.approx(0.0, abs=4.0 * 20.0 / math.sqrt(n))
    assert error.std() == pytest.approx(20.0, rel=4.0 / math.sqrt(2 * n) + 0.003)  # 0.3 %: neighbours are mixed up
    wide = read_out(made(t_us, p=np.arange(len(t_us)) % 2), jitter_s=2e-4)
    assert np.all(np.diff(wide["t"]) >= 0)
    assert np.any(np.diff(wide["p"].astype(int)) == 0)


def test_what_is_stamped_outside_the_recording_is_not_in_it() -> None:
    n = ROI.pixels
    x, y = ROI.x + np.arange(n) % ROI.width, ROI.y + np.arange(n) // ROI.width
    for edge_us in (0.0, DURATION_S * 1e6):
        events = read_out(made(np.full(n, edge_us), x, y), jitter_s=1e-3)
        assert len(events) == pytest.approx(n / 2, abs=4.0 * math.sqrt(n / 4))


# Trail filter


@pytest.mark.effect("trail_filter", shows="closed_form")
def test_only_the_first_event_of_a_run_passes() -> None:
    t_us = [0, 100, 900, 1800, 1900, 2000, 3000, 3999]
    polarity = [1, 1, 1, 1, 0, 0, 0, 0]
    passed = read_out(made(t_us, p=polarity), trail_s=1e-3)
    # 1900 is another polarity; 3000 follows a gap of 1000; 3999 one of 999.
    assert passed["t"].tolist() == [0, 1900, 3000]


def test_runs_are_counted_in_each_pixel() -> None:
    passed = read_out(made([0, 10, 20, 30], x=[15, 16, 15, 16]), trail_s=1e-3)
    assert passed["t"].tolist() == [0, 10]


# Rate limit


def test_each_period_passes_so_many_events_at_random() -> None:
    n = 300  # in each of 100 periods of 10 ms; 120 may pass
    t_us = np.repeat(1e4 * np.arange(100), n) + np.tile(10.0 * np.arange(n), 100)
    passed = read_out(made(t_us), limit_eps=12_000.0, limit_period_s=1e-2)
    assert np.bincount(passed["t"] // 10_000).tolist() == [120] * 100
    share = np.bincount(passed["t"] % 10_000 // 10, minlength=n) / 100.0
    assert share == pytest.approx(0.4, abs=5.0 * math.sqrt(0.24 / 100))
    first_half = share[: n // 2].mean()
    assert first_half == pytest.approx(0.4, abs=4.0 * math.sqrt(0.24 / 15_000))


def test_a_limit_that_is_no_whole_number_is_one_on_average() -> None:
    t_us = np.repeat(1e3 * np.arange(1000), 5) + np.tile(np.arange(5.0), 1000)
    passed = read_out(made(t_us), limit_eps=2600.0, limit_period_s=1e-3)
    assert len(passed) == 2600
    assert set(np.bincount(passed["t"] // 1000)) == {2, 3}


def test_below_the_limit_nothing_is_dropped() -> None:
    assert len(read_out(made(1e3 * np.arange(900.0)), limit_eps=1000.0, limit_period_s=1e-3)) == 900
