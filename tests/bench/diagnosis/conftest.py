"""Points that lie in memory, and the runs that simulated sensors took of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.models.simulation import on_sensor, simulate_point
from bench.store.data import PointData, RunHeader, Sensor
from drivers.events.types import EVENT_DTYPE, empty_events
from protocols.points import Roi
from sim_backend.pixel import FastEngine

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import numpy.typing as npt

    from sim_backend.pixel import PixelModel

ROI = Roi(40, 30, 8, 8)
SENSOR = Sensor("made", 1280, 720, 4.86e-6, 0.6)
ENGINE = FastEngine(dt_s=2e-5)


@dataclass(frozen=True, slots=True)
class Taken(PointData):
    """A point whose events lie in memory."""

    stored: npt.NDArray[np.void] = field(default_factory=empty_events)

    def events(self, chunk: int = 1_000_000) -> Iterator[npt.NDArray[np.void]]:
        yield self.stored


@dataclass(frozen=True, slots=True)
class Memory:
    """A run in memory."""

    taken: tuple[PointData, ...]
    header: RunHeader = field(default_factory=lambda: RunHeader("made", SENSOR, ROI))
    folder: Path = Path("made")

    def points(self) -> Iterator[PointData]:
        yield from self.taken


def make_point(index: int, contrast: float, lux: float = 10.0, periods: int = 10, half_s: float = 0.05,
               **changes: Any) -> Taken:  # fmt: skip
    """Return a square wave, or constant light for as long where the contrast is 0."""
    edges = np.arange(2 * periods + 1) * half_s if contrast else np.zeros(1)
    pulses = len(edges) - 1
    values: dict[str, Any] = {
        "path": Path(f"{index:06}.h5"),
        "index": index,
        "waveform": "square" if contrast else "constant",
        "polarity": "both",
        "baseline_lux": lux,
        "log_contrast": contrast,
        "duration_s": (2 * periods + 1) * half_s if contrast else 5.0,
        "nd_od": 0.0,
        "refractory_s": 8e-3,
        "temperature_c": math.nan,
        "roi": ROI,
        "n_events": 0,
        "stimulus_t_s": edges,
        "stimulus_lux": lux * np.exp(contrast * (np.arange(len(edges)) % 2)),
        "pulse_start_s": edges[1:],
        "pulse_stop_s": edges[1:] + half_s,
        "pulse_kind": (np.arange(pulses) % 2).astype(np.uint8),
        "pulse_valid": np.ones(pulses, np.bool_),
        "pulse_log_contrast": np.full(pulses, contrast),
        "triggers_t_us": np.zeros(0, np.int64),
        "triggers_p": np.zeros(0, np.uint8),
        "masked": np.zeros((0, 2), np.uint16),
        "gaps_s": np.zeros((0, 2)),
        "bias": {},
        "quality": {},
        "attributes": {},
    }
    return Taken(**(values | changes))


def with_events(asked: Taken, events: Sequence[tuple[int, int, int, int]]) -> Taken:
    """Return the point with these events: time in us, pixel from the corner of the window, polarity."""
    stored = np.array([(t, ROI.x + x, ROI.y + y, p) for t, x, y, p in events], dtype=EVENT_DTYPE)
    return replace(asked, stored=stored, n_events=len(stored))


def take(points: Sequence[Taken], model: PixelModel, seed: int) -> Memory:
    """Return the run that one sensor of this model took."""
    found = []
    for asked in points:
        parts = simulate_point(
            asked, on_sensor(model, SENSOR), ENGINE, sensor_seed=seed, seed=1000 * seed + asked.index
        )
        stored = np.concatenate([empty_events(), *parts])
        found.append(replace(asked, stored=stored, n_events=len(stored)))
    return Memory(tuple(found))


@pytest.fixture
def point() -> Callable[..., Taken]:
    """Make a point without events."""
    return make_point


@pytest.fixture
def recorded() -> Callable[[Taken, Sequence[tuple[int, int, int, int]]], Taken]:
    """Put events into a point."""
    return with_events


@pytest.fixture
def run_of() -> Callable[[Sequence[Taken], PixelModel, int], Memory]:
    """Have a simulated sensor take points."""
    return take


@pytest.fixture(scope="session")
def make() -> tuple[Callable[..., Taken], Callable[[Sequence[Taken], PixelModel, int], Memory]]:
    """Make points, and have a simulated sensor take them; for fixtures that last."""
    return make_point, take
