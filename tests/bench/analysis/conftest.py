"""Points and runs made by hand: the events are known, and so is what must be found in them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.store.data import PointData, RunHeader, Sensor
from drivers.events.types import EVENT_DTYPE, empty_events
from protocols.points import Roi

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import numpy.typing as npt

WINDOW = Roi(100, 50, 4, 3)


@dataclass(frozen=True, slots=True)
class MemoryPoint(PointData):
    """A point whose events lie in memory."""

    stored: npt.NDArray[np.void] = field(default_factory=empty_events)

    def events(self, chunk: int = 1_000_000) -> Iterator[npt.NDArray[np.void]]:
        for start in range(0, self.stored.size, chunk):
            yield self.stored[start : start + chunk]


@dataclass(frozen=True, slots=True)
class MemoryRun:
    """A run in memory."""

    taken: tuple[PointData, ...]
    header: RunHeader = field(
        default_factory=lambda: RunHeader("run", Sensor("hand-made", 1280, 720, 4.86e-6, 0.6), WINDOW, "by hand")
    )

    def points(self) -> Iterator[PointData]:
        yield from self.taken


def events_of(rows: Sequence[tuple[int, int, int, int]]) -> npt.NDArray[np.void]:
    """Return events from (t_us, x, y, p), sorted by time."""
    return np.array(sorted(rows), EVENT_DTYPE) if rows else empty_events()


def make_point(**changes: Any) -> MemoryPoint:
    """Return a constant point of 10 s without events; everything may be changed."""
    values: dict[str, Any] = {
        "path": Path("nowhere.h5"),
        "index": 0,
        "waveform": "constant",
        "polarity": "both",
        "baseline_lux": 10.0,
        "log_contrast": 0.0,
        "duration_s": 10.0,
        "nd_od": 0.0,
        "refractory_s": 0.01,
        "temperature_c": float("nan"),
        "roi": WINDOW,
        "n_events": 0,
        "stimulus_t_s": np.array([0.0]),
        "stimulus_lux": np.array([10.0]),
        "pulse_start_s": np.zeros(0),
        "pulse_stop_s": np.zeros(0),
        "pulse_kind": np.zeros(0, np.uint8),
        "pulse_valid": np.zeros(0, np.bool_),
        "pulse_log_contrast": np.zeros(0),
        "triggers_t_us": np.zeros(0, np.int64),
        "triggers_p": np.zeros(0, np.uint8),
        "masked": np.zeros((0, 2), np.uint16),
        "gaps_s": np.zeros((0, 2)),
        "bias": {},
        "quality": {},
        "attributes": {},
    }
    values.update(changes)
    if "stored" in values:
        values["n_events"] = values["stored"].size
    pulses = values["pulse_start_s"].size
    if values["pulse_valid"].size != pulses:
        values["pulse_valid"] = np.ones(pulses, np.bool_)
    if values["pulse_log_contrast"].size != pulses:
        values["pulse_log_contrast"] = np.full(pulses, values["log_contrast"])
    return MemoryPoint(**values)


def square_point(log_contrast: float = 0.3, periods: int = 5, half_s: float = 0.1, **changes: Any) -> MemoryPoint:
    """Return a square wave: a dark half first, then bright and dark halves in turn."""
    edges = np.arange(2 * periods + 1) * half_s
    bright = np.arange(2 * periods + 1) % 2 == 1
    values: dict[str, Any] = {
        "waveform": "square",
        "log_contrast": log_contrast,
        "duration_s": (2 * periods + 1) * half_s,
        "stimulus_t_s": edges,
        "stimulus_lux": np.where(bright, 10.0 * np.exp(log_contrast), 10.0),
        "pulse_start_s": edges[1:],
        "pulse_stop_s": edges[1:] + half_s,
        "pulse_kind": np.where(bright[1:], 0, 1).astype(np.uint8),
    }
    return make_point(**(values | changes))


def reset_point(
    log_contrast: float = 0.3, pulses: int = 4, kind: int = 0, reset: float = 0.4, **changes: Any
) -> MemoryPoint:
    """Return reset/test pulses of a period of 0.8 s: gap 0.1, reset 0.4 from 0.1 s, gap, test 0.2 from 0.6 s."""
    sign = 1.0 if kind == 0 else -1.0
    starts = np.arange(pulses) * 0.8
    t = np.concatenate([[s, s + 0.1, s + 0.5, s + 0.6] for s in starts])
    lux = np.tile([10.0, 10.0 * np.exp(sign * reset), 10.0, 10.0 * np.exp(sign * log_contrast)], pulses)
    values: dict[str, Any] = {
        "waveform": "reset_test",
        "polarity": "on" if kind == 0 else "off",
        "log_contrast": log_contrast,
        "duration_s": 0.8 * pulses,
        "stimulus_t_s": t,
        "stimulus_lux": lux,
        "pulse_start_s": starts + 0.6,
        "pulse_stop_s": starts + 0.64,
        "pulse_kind": np.full(pulses, kind, np.uint8),
    }
    return make_point(**(values | changes))


@pytest.fixture
def point() -> Callable[..., MemoryPoint]:
    return make_point


@pytest.fixture
def square() -> Callable[..., MemoryPoint]:
    return square_point


@pytest.fixture
def reset_test() -> Callable[..., MemoryPoint]:
    return reset_point


@pytest.fixture
def events() -> Callable[..., npt.NDArray[np.void]]:
    return events_of


@pytest.fixture
def run() -> Callable[..., MemoryRun]:
    def make(*points: PointData) -> MemoryRun:
        return MemoryRun(points)

    return make
