"""A dark current that differs from pixel to pixel is no stray light."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench.diagnosis.expected.catalogue import details_of, free_of
from bench.diagnosis.expected.problem import Slot
from bench.diagnosis.searching.ties import told_apart
from sim_backend.pixel.effects import DarkCurrent

PROBLEM: Any = SimpleNamespace(measured=SimpleNamespace(points=()))
TIES = {"dark_current": ("stray_light",), "leak": ("light_drift",)}


def fit_of(sigmas: float | None) -> Any:
    """Return a fit with a dark current whose spread is so many standard errors from none; None: it is not free."""
    slots = [Slot(free_of(DarkCurrent)[0])]
    if sigmas is not None:
        slots.append(Slot(details_of(DarkCurrent)[0][0]))
    x = np.array([5.0, sigmas or 0.0])[: len(slots)]
    return SimpleNamespace(slots=slots, x=x, covariance=lambda _: np.eye(len(slots)))


@pytest.mark.parametrize("sigmas", [None, 0.0, 3.0])
def test_they_are_tied_as_long_as_all_pixels_may_have_the_same(sigmas: float | None) -> None:
    assert told_apart(TIES, PROBLEM, fit_of(sigmas)) == TIES


def test_a_spread_tells_them_apart() -> None:
    assert told_apart(TIES, PROBLEM, fit_of(8.0)) == {"leak": ("light_drift",)}
    both = {"dark_current": ("photoreceptor_bandwidth", "stray_light")}
    assert told_apart(both, PROBLEM, fit_of(8.0)) == {"dark_current": ("photoreceptor_bandwidth",)}
