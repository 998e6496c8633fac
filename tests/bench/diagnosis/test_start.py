"""Numbers by eye: exact for a pixel without noise."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.expected.residuals import measured
from bench.diagnosis.expected.start import Guess, guesses
from bench.diagnosis.recorded.recording import Frame, Recording
from bench.diagnosis.recorded.summary import summarise
from bench.diagnosis.views.registry import VIEWS
from sim_backend.pixel import PixelModel

if TYPE_CHECKING:
    from collections.abc import Callable

TAU_S = 1e-3
OTHERWISE = Guess(0.2, 0.2, 0.05, 100.0)


class Seen:
    """What a problem says of its points."""

    def __init__(self, points: list[Any]) -> None:
        self.points = points
        self.setting = [0] * len(points)
        self.measured = measured([summarise(Recording(Frame(p), p.events()), VIEWS) for p in points])


def answered(point: Callable[..., Any], recorded: Callable[..., Any], index: int, contrast: float) -> Any:
    """Return a point whose pixels all answer as a noise-free pixel with thresholds 0.3 and 0.22 does."""
    asked = point(index, contrast)
    events = []
    for start_s, kind in zip(asked.pulse_start_s, asked.pulse_kind, strict=True):
        theta = 0.3 if kind == 0 else 0.22
        if contrast > 0.3:
            t = round(1e6 * (start_s + TAU_S * math.log(contrast / (contrast - theta))))
            events += [(t, x, y, 1 - int(kind)) for x in range(8) for y in range(8)]
    return recorded(asked, events)


def test_thresholds_and_corner_follow_from_two_latencies(
    point: Callable[..., Any], recorded: Callable[..., Any]
) -> None:
    seen: Any = Seen([answered(point, recorded, i, c) for i, c in enumerate((0.2, 0.28, 0.6, 1.0))])
    found = guesses(seen, 0, OTHERWISE)[0]
    # Time stamps are whole microseconds, the latencies some hundred of them.
    assert found.theta_on == pytest.approx(0.3, rel=0.02)
    assert found.theta_off == pytest.approx(0.22, rel=0.03)
    assert found.corner_hz == pytest.approx(1.0 / (2.0 * np.pi * TAU_S), rel=0.02)


def test_a_run_that_shows_nothing_leaves_the_numbers_as_they_were(point: Callable[..., Any]) -> None:
    seen: Any = Seen([point(0, 0.3), point(1, 0.0)])
    assert guesses(seen, 0, OTHERWISE) == [OTHERWISE]


@pytest.mark.parametrize("contrasts", [(0.15, 0.22, 0.26, 0.3, 0.35, 0.45, 0.6, 1.0), (0.2, 0.28, 0.36, 0.5, 1.0)])
def test_thresholds_that_look_larger_than_they_are_are_among_the_guesses(
    point: Callable[..., Any], run_of: Callable[..., Any], contrasts: tuple[float, ...]
) -> None:
    # Large steps are answered more than once, and the pixel remembers less than all of them.
    quick = PixelModel(noise_rms=0.036, corner_hz=78.0, theta_on=0.28, theta_off=0.2, refractory_s=1.5e-3)
    points = [point(i, c, refractory_s=quick.refractory_s) for i, c in enumerate(contrasts)]
    seen: Any = Seen(list(run_of(points, quick, 3).points()))
    found = guesses(seen, 0, OTHERWISE)
    assert abs(found[0].theta_off - quick.theta_off) > quick.theta_off
    far = [abs(math.log(g.theta_on / quick.theta_on)) + abs(math.log(g.theta_off / quick.theta_off)) for g in found]
    assert min(far) < 0.4  # a fifth each
