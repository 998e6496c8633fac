"""Which threshold a square wave shows, from simulated pixels of known thresholds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bench.analysis.grouping import Entry
from bench.analysis.square_wave import less_sensitive
from bench.analysis.tally import tally_point
from drivers.events.types import EVENT_DTYPE

_STEP_S, _TAU_S, _RMS, _DEAD, _HALF = 5e-4, 3e-3, 0.04, 16, 100


def _simulated(square: Any, log_contrast: float, on: float, off: float, seed: int) -> Any:
    """Return a square wave of 12 x 10 pixels: first-order noise of 0.04 rms, 8 ms of dead time, halves of 50 ms."""
    rng = np.random.default_rng(seed)
    pixels, periods = 120, 40
    keep = np.exp(-_STEP_S / _TAU_S)
    signal, noise = np.zeros(pixels), _RMS * rng.standard_normal(pixels)
    reference, dead = noise.copy(), np.zeros(pixels, np.int64)
    rows = []
    for i in range((2 * periods + 1) * _HALF):
        level = log_contrast * ((i // _HALF) % 2)
        signal = level + (signal - level) * keep
        noise = noise * keep + _RMS * np.sqrt(1.0 - keep * keep) * rng.standard_normal(pixels)
        value = signal + noise
        reference = np.where(dead == 1, value, reference)
        live = dead <= 1
        dead = np.maximum(dead - 1, 0)
        for p, fired in ((1, live & (value - reference >= on)), (0, live & (value - reference <= -off))):
            rows += [(int(i * _STEP_S * 1e6), 100 + k % 12, 50 + k // 12, p) for k in np.flatnonzero(fired)]
            dead[fired] = _DEAD
    from protocols.points import Roi

    stored = np.array(rows, EVENT_DTYPE)
    return square(log_contrast, periods=periods, half_s=0.05, stored=stored, roi=Roi(100, 50, 12, 10), index=seed)


def _entries(points: list[Any], which: int) -> list[Entry]:
    tallies = [(p, tally_point(p)) for p in points]
    return [Entry(p.index, "square", 10.0, 0.0, {}, p.roi, t.active, t.groups[which]) for p, t in tallies]


@pytest.mark.parametrize(
    ("on", "off", "larger"), [(0.32, 0.24, "on"), (0.24, 0.32, "off"), (0.3, 0.3, None)], ids=["on", "off", "equal"]
)
def test_the_order_of_events_tells_the_larger_threshold(
    square: Any, on: float, off: float, larger: str | None
) -> None:
    points = [_simulated(square, c, on, off, seed) for seed, c in enumerate((0.19, 0.22, 0.25))]
    on_answers, off_answers = _entries(points, 0), _entries(points, 1)
    shares = [float(e.tally.answers.mean()) / e.tally.test.pulses for e in (*on_answers, *off_answers)]
    assert any(0.05 < share < 0.9 for share in shares), "the contrasts lie within the transition"
    assert less_sensitive(on_answers, off_answers) == larger


def test_without_events_nothing_is_told(square: Any) -> None:
    points = [square(0.3)]
    assert less_sensitive(_entries(points, 0), _entries(points, 1)) is None
