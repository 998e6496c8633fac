"""What is expected of the truth of a case, and how unlike it other models are."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.diagnosis.expected.forward import engine_of
from bench.diagnosis.expected.phases import with_phases
from bench.diagnosis.expected.residuals import expectation, measured
from bench.diagnosis.recorded.recording import Frame, Recording
from bench.diagnosis.recorded.summary import add, summarise
from bench.diagnosis.views.registry import VIEWS
from bench.models.simulation import on_sensor, recording_seed, simulate_point
from benchmarks.planted.falls import believed
from benchmarks.planted.runs import ROI, SENSOR, phases_in_run, planned_points
from protocols.points import Roi

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.residuals import Measured
    from bench.diagnosis.recorded.summary import Summary
    from bench.store.data import PointData
    from benchmarks.planted.cases import Case
    from benchmarks.planted.falls import Pair
    from sim_backend.pixel import PixelModel

    Floats = npt.NDArray[np.float64]

__all__ = ["SLOW", "TIMING_US", "Truth"]

#: Two sets of so many sensors, if not asked for more. Sets share no random numbers, models within a set share all.
_SENSORS: Final = 3
_SETS: Final = 2
#: Sets of so many sensors from which the changes by the base numbers are known, and those by what mimics an effect.
_OTHER_SETS: Final = (2, 3)
_OTHERS: Final = 2
#: Events and stimulus are known to be no further apart than this.
TIMING_US: Final = 10
#: Effects that are seen in fewer pixels.
SLOW: Final = frozenset({"high_pass"})
_QUARTER: Final = Roi(ROI.x, ROI.y, ROI.width // 2, ROI.height // 2)


class _Bench:
    """The points of a case, and what simulated sensors of models show there.

    What takes long is simulated in a quarter of the pixels, and sizes are made twice as large: they go with the root
    of the number of pixels. The comparators look as often as they did in the case: events that come at the same look
    wait for each other in a readout, and seldom looks would make that a large effect. A ripple has the phase that it
    has in each recording: at any other one the recording would be another.
    """

    def __init__(self, case: Case) -> None:
        slow = any(e.id in SLOW or e.hooks() for e in case.model.effects)
        self.points: list[PointData] = planned_points(case)
        if slow:
            self.points = [replace(p, roi=_QUARTER) for p in self.points]
        self.scale = 2.0 if slow else 1.0
        self._phases = dict(zip((p.index for p in self.points), phases_in_run(case), strict=True))
        self._seed = case.seed
        self._engine = engine_of(case.dt_s)

    def see(self, model: PixelModel, of_set: int, sensors: int, late_us: int = 0) -> list[list[Summary]]:
        """Return what each point shows, for each sensor of a set, when all events come somewhat late."""
        return [[self._look(p, model, of_set, sensor, late_us) for p in self.points] for sensor in range(sensors)]

    def _look(self, point: PointData, model: PixelModel, of_set: int, sensor: int, late_us: int) -> Summary:
        pixels = recording_seed(self._seed + of_set, sensor, 0)
        noise = recording_seed(self._seed + of_set, sensor, 1 + point.index)
        [there] = with_phases([on_sensor(model, SENSOR)], [self._phases[point.index]])
        events = simulate_point(point, there, self._engine, sensor_seed=pixels, seed=noise)
        return summarise(Recording(Frame(point), (_later(e, late_us) for e in events)), VIEWS)


def _later(events: npt.NDArray[np.void], late_us: int) -> npt.NDArray[np.void]:
    moved = events.copy()
    moved["t"] += late_us
    return moved


class Truth:
    """What is expected of the truth of a case, and how unlike others are."""

    def __init__(self, case: Case, model: PixelModel, sensors: int = _SENSORS) -> None:
        self.bench = _Bench(case)
        self._sensors = sensors
        seen = [self.bench.see(model, s, sensors) for s in range(_SETS)]
        self.of: Measured = measured(seen[0][0])
        every = expectation(self.of, [add(c) for c in zip(*seen[0], *seen[1], strict=True)])
        more = math.sqrt(1.0 + 1.0 / every.recordings)
        self._roots = [root * more for root in every.roots]
        self._values = [self.value(one) for one in seen]
        self._known: dict[tuple[PixelModel, int], Floats] = {}

    def value(self, sensors: Sequence[Sequence[Summary]]) -> Floats:
        """Return the expected statistics."""
        return expectation(self.of, [add(c) for c in zip(*sensors, strict=True)]).value

    def whiten(self, values: Floats) -> Floats:
        """Return independent numbers of unit variance."""
        parts = [root @ values[where] for root, where in zip(self._roots, self.of.points, strict=True)]
        return np.concatenate(parts)

    def apart(self, model: PixelModel, truth: PixelModel | None = None, late_us: int = 0) -> Pair:
        """Return the truth, or another one in its place, less a model whose events come somewhat late."""
        first, second = (
            self.whiten((mine if truth is None else self._seen(truth, s)) - self._seen(model, s, late_us))
            for s, mine in enumerate(self._values)
        )
        return first, second

    def _seen(self, model: PixelModel, of_set: int, late_us: int = 0) -> Floats:
        return self.value(self.bench.see(model, of_set, self._sensors, late_us))

    def changes(self, model: PixelModel, others: Sequence[PixelModel], steps: Sequence[float]) -> Pair:
        """(n, k) change from a model to each of the others, by unit of its step, from each of two sets."""
        return believed(*(self._changes(model, others, steps, s) for s in _OTHER_SETS))

    def _changes(
        self, model: PixelModel, others: Sequence[PixelModel], steps: Sequence[float], of_set: int
    ) -> Floats:  # fmt: skip
        here = self._here(model, of_set)
        columns = [
            self.whiten(self.value(self.bench.see(one, of_set, _OTHERS)) - here) / step
            for one, step in zip(others, steps, strict=True)
        ]
        return np.stack(columns, axis=1)

    def delayed(self, model: PixelModel) -> Pair:
        """(n, 1) change when all events come as late as the clocks may be apart, from each of two sets."""
        return believed(*(self._delayed(model, s)[:, None] for s in _OTHER_SETS))

    def _delayed(self, model: PixelModel, of_set: int) -> Floats:
        late = self.value(self.bench.see(model, of_set, _OTHERS, TIMING_US))
        return self.whiten(late - self._here(model, of_set))

    def _here(self, model: PixelModel, of_set: int) -> Floats:
        """Return what is expected of a model; many are laid beside the same one."""
        if (model, of_set) not in self._known:
            self._known[model, of_set] = self.value(self.bench.see(model, of_set, _OTHERS))
        return self._known[model, of_set]
