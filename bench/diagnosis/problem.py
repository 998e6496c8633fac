"""A run, the model's free numbers, and the simulations that lie between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench.diagnosis.parameters import ALIGNMENT, Free, base_parameters, put, time_offset
from bench.diagnosis.recording import Frame, Recording
from bench.diagnosis.residuals import Measured, expectation, measured
from bench.diagnosis.start import Guess, guess
from bench.diagnosis.summary import add, summarise
from bench.diagnosis.views.registry import VIEWS

if TYPE_CHECKING:
    from collections.abc import Hashable, Sequence

    import numpy.typing as npt

    from bench.diagnosis.forward import Forward
    from bench.diagnosis.residuals import Expectation
    from bench.diagnosis.summary import Summary
    from bench.store.data import PointData
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]

__all__ = ["Problem", "Slot", "settings_of"]

#: What may differ between settings of the camera; the noise is taken to be that of the pixel.
_OF_A_SETTING = frozenset({"thresholds", "source_follower_bandwidth", "refractory_period"})

#: Times are known no better than this beside the stimulus.
_TIMING_S = 1e-5


@dataclass(frozen=True, slots=True)
class Slot:
    """A free number, of all points or of those at one setting."""

    free: Free
    setting: int | None = None

    def key(self, settings: int) -> str:
        """Return its name in results; the setting is named where there are several."""
        return self.free.key if self.setting is None or settings == 1 else f"{self.free.key}@{self.setting}"


def settings_of(points: Sequence[PointData]) -> list[int]:
    """Return for each point the number of its setting of the camera: points of one share thresholds and corner."""
    known: dict[Hashable, int] = {}
    return [known.setdefault((tuple(sorted(p.bias.items())), repr(p.refractory_s)), len(known)) for p in points]


@dataclass(frozen=True)
class Problem:
    """What is to be explained, and how a model is laid beside it."""

    points: tuple[PointData, ...]
    forward: Forward
    measured: Measured
    setting: tuple[int, ...]  #: of each point
    timing_sd_s: float  #: how well the events' times are known beside those of the stimulus

    @classmethod
    def of(cls, points: Sequence[PointData], forward: Forward) -> Problem:
        """Look at the events of all points."""
        seen = [summarise(Recording(Frame(p), p.events()), VIEWS) for p in points]
        return cls(tuple(points), forward, measured(seen), tuple(settings_of(points)), max(forward.dt_s, _TIMING_S))

    @property
    def settings(self) -> int:
        """Number of settings of the camera."""
        return max(self.setting, default=-1) + 1

    def base_slots(self) -> list[Slot]:
        """Return the free numbers of the base pixel."""
        known = all(np.isfinite(p.refractory_s) for p in self.points)
        slots = []
        for free in base_parameters(refractory_known=known):
            per_setting = free.owner in _OF_A_SETTING
            slots += [Slot(free, s) for s in range(self.settings)] if per_setting else [Slot(free)]
        return [*slots, Slot(time_offset(self.timing_sd_s))]

    def models(self, model: PixelModel, slots: Sequence[Slot], x: Sequence[float] | Floats) -> list[PixelModel]:
        """Return the model of each point."""
        by_setting = []
        for setting in range(self.settings):
            mine = [(s.free, c) for s, c in zip(slots, x, strict=True) if s.setting in (None, setting)]
            by_setting.append(put(model, [f for f, _ in mine], [c for _, c in mine]))
        return [by_setting[s] for s in self.setting]

    def simulate(self, models: Sequence[Sequence[PixelModel]], seed: int, sensors: int) -> list[list[list[Summary]]]:
        """Return the summaries of each sensor of each model."""
        return self.forward.run(models, seed, sensors)

    def expect(self, sensors: Sequence[Sequence[Summary]]) -> Expectation:
        """Return what some simulated sensors let expect."""
        return expectation(self.measured, [add(column) for column in zip(*sensors, strict=True)])

    def start(self, model: PixelModel, *, by_eye: bool = True) -> list[float]:
        """Return the coordinates of the base pixel's numbers: those of the model, or what the curves show by eye."""
        own = Guess(model.theta_on, model.theta_off, model.noise_rms, model.corner_hz)
        guesses = [guess(self, s, own) if by_eye else own for s in range(self.settings)]
        found = []
        for slot in self.base_slots():
            setting = slot.setting or 0
            if slot.free.owner == ALIGNMENT:
                found.append(0.0)
                continue
            if slot.free.owner == "refractory_period":
                first = self.points[self.setting.index(setting)]
                value = first.refractory_s if np.isfinite(first.refractory_s) else model.refractory_s
            else:
                value = getattr(guesses[setting], slot.free.field)
            found.append(slot.free.coordinate(max(value, slot.free.lowest)))
        return found
