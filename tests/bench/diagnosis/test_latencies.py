"""Latencies, and how they scatter, go with each other for each polarity by itself."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench.diagnosis.expected.problem import _blurred
from bench.diagnosis.fitting.looks import later
from bench.diagnosis.recorded.summary import Label

#: ON events come soon, OFF events late; the order is that of the views.
SOON_S, LATE_S = 2e-4, 5e-3
SPREAD = 0.09


def label(view: str, part: Any) -> Label:
    return Label(0, view, part, "mean", "1", 10.0, 0.5, 0.08, 0.0, 1.0, of_array=False, by_pulse=False)


LABELS = tuple(label(view, part) for view in ("latency", "latency_spread") for part in ("on", "off"))
RATIO = np.array([math.log(SOON_S), math.log(LATE_S), SPREAD, SPREAD])


def test_the_spread_of_soon_events_falls_as_theirs_does_when_all_come_later() -> None:
    """By numbers: events of a log-normal law, and the same 1 us later."""
    problem: Any = SimpleNamespace(measured=SimpleNamespace(labels=LABELS))
    here: Any = SimpleNamespace(value=RATIO, ratio=RATIO)
    rng = np.random.default_rng(3)
    dt = 1e-6
    expected = []
    for middle in (SOON_S, LATE_S):
        # A step from one latency to the next has twice the variance of one.
        t = middle * np.exp(math.sqrt(0.5 * SPREAD) * rng.standard_normal(400_000))
        soon, late = np.log(t), np.log(t + dt)
        expected.append(((late - soon).mean() / dt, 2.0 * (late.var() - soon.var()) / dt))
    found = later(problem, here)
    for at, (mean, spread) in enumerate(expected):
        assert found[at] == pytest.approx(mean, rel=0.05)
        assert found[2 + at] == pytest.approx(spread, rel=0.1)


def test_each_is_known_no_better_than_its_own_latency_allows() -> None:
    on, off, spread_on, spread_off = (label.least for label in _blurred(LABELS, RATIO, 1e-5))
    assert (on, off) == pytest.approx((1e-5 / SOON_S, 1e-5 / LATE_S))
    assert (spread_on, spread_off) == pytest.approx((on**2, off**2))
    alone = _blurred(LABELS[2:], RATIO[2:], 1e-5)  # of latencies nothing is known
    assert [label.least for label in alone] == [0.0, 0.0]
