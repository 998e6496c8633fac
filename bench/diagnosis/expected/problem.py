"""A run, the model's free numbers, and the simulations that lie between them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from bench.diagnosis.expected.catalogue import cost_of, least_share, numbers_of
from bench.diagnosis.expected.parameters import ALIGNMENT, DEAD_TIME_KNOWN, Free, base_parameters, put, time_offset
from bench.diagnosis.expected.phases import with_phases
from bench.diagnosis.expected.residuals import Measured, expectation, measured
from bench.diagnosis.expected.same_law import representatives
from bench.diagnosis.expected.start import Guess, guesses
from bench.diagnosis.recorded.excerpt import ENOUGH_EVENTS
from bench.diagnosis.recorded.outlying import outlying_pixels
from bench.diagnosis.recorded.recording import Frame, Recording
from bench.diagnosis.recorded.summary import add, summarise
from bench.diagnosis.views.registry import all_views, views
from sim_backend.pixel.effects.hot_pixels import HotPixels

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import numpy.typing as npt

    from bench.diagnosis.expected.forward import Forward, Sensor
    from bench.diagnosis.expected.residuals import Expectation
    from bench.diagnosis.recorded.outlying import Outlying
    from bench.diagnosis.recorded.summary import Label, Summary
    from bench.store.data import PointData
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]

__all__ = ["Known", "Problem", "Slot", "settings_of"]

#: What may differ between settings of the camera; the noise is taken to be that of the pixel.
_OF_A_SETTING: Final = frozenset({"thresholds", "source_follower_bandwidth", "refractory_period"})

#: Sensors that are simulated at the least: what differs between them is chance.
_SENSORS: Final = 2
#: Runs that are simulated of a model, at the least and at the most.
_LEAST: Final = 0.0625
_MOST: Final = 24.0

#: What is read off the events moves by no more than about this share of how well it is known.
_HELD: Final = 0.3

#: Views of latencies, as logarithms.
_LATENCIES: Final = frozenset({"latency", "latency_10", "latency_50", "latency_90"})
#: Times are known no better than this beside the stimulus.
_TIMING_S: Final = 1e-5


@dataclass(frozen=True, slots=True)
class Slot:
    """A free number, of all points or of those at one setting."""

    free: Free
    setting: int | None = None

    def key(self, settings: int) -> str:
        """Return its name in results; the setting is named where there are several."""
        return self.free.key if self.setting is None or settings == 1 else f"{self.free.key}@{self.setting}"


class Known(NamedTuple):
    """A number that is read off the events: its coordinate, and how well that is known."""

    at: float
    sd: float


def settings_of(points: Sequence[PointData]) -> list[int]:
    """Return for each point the number of its setting of the camera: points of one share its numbers.

    Points have another setting where their biases differ, or stated dead times by more than these are believed.
    """
    known: list[PointData] = []
    found = []
    for point in points:
        number = next((n for n, one in enumerate(known) if _is_one_setting(one, point)), len(known))
        if number == len(known):
            known.append(point)
        elif math.isnan(known[number].refractory_s):
            known[number] = point
        found.append(number)
    return found


def _is_one_setting(one: PointData, other: PointData) -> bool:
    dead, its = one.refractory_s, other.refractory_s
    # NaN: nobody stated it, and it is what it is at the other point.
    return one.bias == other.bias and not abs(dead - its) > DEAD_TIME_KNOWN * max(dead, its)


def _blurred(labels: Sequence[Label], ratio: Floats, blur_s: float) -> tuple[Label, ...]:
    """Return the labels; the logarithms of latencies are known no better than this difference of times allows."""
    share = {
        (label.view, label.group): blur_s * math.exp(-value) if np.isfinite(value) else 0.0
        for label, value in zip(labels, ratio, strict=True) if label.view in _LATENCIES
    }  # fmt: skip
    found = []
    for label in labels:
        if label.view in _LATENCIES:
            label = replace(label, least=share[label.view, label.group])
        elif label.view == "latency_spread":
            label = replace(label, least=share.get(("latency", label.group), 0.0) ** 2)
        found.append(label)
    return tuple(found)


def _measured(seen: Sequence[Summary], blur_s: float) -> Measured:
    """Return the statistics of a run; latencies are compared no finer than the sensor and the simulation cut time."""
    found = measured(seen)
    return replace(found, labels=_blurred(found.labels, found.ratio, blur_s)) if blur_s > 0.0 else found


def _by_eye(points: Sequence[PointData], outlying: Outlying | None) -> dict[str, dict[str, float]]:
    """Return numbers of effects that show without a model."""
    found = {}
    ripples = [float(p.attributes["ripple_hz"]) for p in points if "ripple_hz" in p.attributes]
    if ripples:
        found["light_flicker"] = {"frequency_hz": ripples[0]}
    if outlying is not None:
        found[HotPixels.id] = {"rate_hz": outlying.rate_hz}
    return found


def _counted(outlying: Outlying | None) -> dict[tuple[str, str], Known]:
    """Return the numbers of hot pixels as their events let them be counted.

    Simulated sensors have other pixels that are hot, and far fewer of these than would tell a share as well.
    """
    if outlying is None or not math.isfinite(outlying.fraction_sd):
        return {}
    return {
        (HotPixels.id, "fraction"): Known(outlying.fraction, outlying.fraction_sd),
        (HotPixels.id, "rate_hz"): Known(math.log(outlying.rate_hz), outlying.log_rate_sd),
    }


class Change(NamedTuple):
    """How expected values differ between two models."""

    halves: Floats  #: (2, n) of two sensors
    recordings: float  #: simulated ones behind each, of all pixels


@dataclass(frozen=True)
class Problem:
    """What is to be explained, and how a model is laid beside it."""

    points: tuple[PointData, ...]
    forward: Forward
    measured: Measured
    setting: tuple[int, ...]  #: of each point
    timing_sd_s: float  #: how well the events' times are known beside those of the stimulus
    given: Mapping[str, Mapping[str, float]]  #: of effects: numbers that can be seen by eye
    known: Mapping[tuple[str, str], Known] = field(default_factory=dict)  #: of numbers, by effect and name
    phases: tuple[float | None, ...] = ()  #: of a ripple in each recording, as far as they are known
    thrift: float = 1.0
    """Of all efforts: a run of more events than are enough takes no longer than one of so many. As much less of it is
    simulated, and expected values are known as much less well."""
    blur_s: float = 0.0  #: how differently the sensor and the simulation may cut time

    @classmethod
    def of(cls, points: Sequence[PointData], forward: Forward, blur_s: float = 0.0) -> Problem:
        """Look at the events of all points.

        Parameters
        ----------
        points
            With the ripple of the run, if one was seen: see :func:`~bench.diagnosis.recorded.ripple.with_ripple`.
        blur_s
            How differently the sensor and the simulation may cut time, s: latencies are compared no finer.
        """
        recordings = (Recording(Frame(p), p.events()) for p in points)
        seen, events = zip(*((summarise(r, views()), r.t_us.size) for r in recordings), strict=True)
        found = _measured(seen, blur_s)
        timing_s, outlying = max(forward.dt_s, _TIMING_S), outlying_pixels(points)
        return cls(
            tuple(points), forward, found, tuple(settings_of(points)), timing_s, _by_eye(points, outlying),
            _counted(outlying),
            thrift=min(1.0, ENOUGH_EVENTS / max(sum(events), 1)), blur_s=blur_s,
        )  # fmt: skip

    def with_shown(self) -> Problem:
        """Return the same, looked at with the views by which no fit goes, too."""
        seen = [summarise(Recording(Frame(p), p.events()), all_views()) for p in self.points]
        return replace(self, forward=self.forward.with_shown(), measured=_measured(seen, self.blur_s))

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

    def slots_of(self, model: PixelModel) -> list[Slot]:
        """Return the free numbers of the base pixel, and of the effects that a model has."""
        return [*self.base_slots(), *(Slot(self.told(f)) for e in model.effects for f in numbers_of(e))]

    def told(self, free: Free) -> Free:
        """Return a number; one that is known from the events themselves is held there.

        What a simulation says of it is less, and comes from the same events.
        """
        known = self.known.get((free.owner, free.name))
        return free if known is None else replace(free, prior_sd=_HELD * known.sd)

    def start_of(self, free: Free, coordinate: float) -> float:
        """Return the coordinate to start from: what the events themselves tell, or another one."""
        known = self.known.get((free.owner, free.name))
        return coordinate if known is None else known.at

    def models(self, model: PixelModel, slots: Sequence[Slot], x: Sequence[float] | Floats) -> list[PixelModel]:
        """Return the model of each point."""
        by_setting = self.of_settings(model, slots, x)
        return self.of_points([by_setting[s] for s in self.setting])

    def of_settings(self, model: PixelModel, slots: Sequence[Slot], x: Sequence[float] | Floats) -> list[PixelModel]:
        """Return the model at each setting of the camera."""
        by_setting = []
        for setting in range(self.settings):
            mine = [(s.free, c) for s, c in zip(slots, x, strict=True) if s.setting in (None, setting)]
            by_setting.append(put(model, [f for f, _ in mine], [c for _, c in mine]))
        return by_setting

    def of_points(self, models: Sequence[PixelModel]) -> list[PixelModel]:
        """Return the models of all points, with what differs from recording to recording and is known."""
        return with_phases(models, self.phases) if self.phases else list(models)

    def cost(self, models: Sequence[PixelModel]) -> float:
        """Return the time of a simulated run beside that of a base pixel to which all points are different."""
        return cost_of(models[0]) / self.alike(models)

    def alike(self, models: Sequence[PixelModel]) -> float:
        """Return how many points of the run are simulated as one, on average."""
        return len(models) / max(len(set(representatives(self.points, models))), 1)

    def simulate(self, models: Sequence[Sequence[PixelModel]], seed: int, effort: float) -> list[list[Sensor]]:
        """Return what simulated sensors of each model show: two or more, of as many pixels as the effort allows.

        Parameters
        ----------
        effort
            Runs of the base pixel, to which all points are different, that take as long.
        """
        return self._simulated(models, self._wanted(models, effort), seed)

    def _wanted(self, models: Sequence[Sequence[PixelModel]], effort: float) -> list[tuple[int, float]]:
        """Return how many sensors of each model to simulate, and the share of the pixels that they have."""
        amounts = [self.thrift * min(max(effort / self.cost(m), _LEAST), _MOST) for m in models]
        sensors = [max(int(a), _SENSORS) for a in amounts]
        shares = [max(a / n, least_share(m[0])) for a, n, m in zip(amounts, sensors, models, strict=True)]
        return [(number, min(share, 1.0)) for number, share in zip(sensors, shares, strict=True)]

    def _simulated(
        self, models: Sequence[Sequence[PixelModel]], wanted: Sequence[tuple[int, float]], seed: int
    ) -> list[list[Sensor]]:
        found: list[list[Sensor]] = [[] for _ in models]
        for number in sorted({number for number, _ in wanted}):
            mine = [i for i, (sensors, _) in enumerate(wanted) if sensors == number]
            shares = [wanted[i][1] for i in mine]
            for i, seen in zip(mine, self.forward.run([models[i] for i in mine], seed, number, shares), strict=True):
                found[i] = seen
        return found

    def whole_sensors(self, models: Sequence[PixelModel], seed: int, number: int) -> list[Sensor]:
        """Return what simulated sensors of all pixels show, however long that takes."""
        return self._simulated([models], [(number, 1.0)], seed)[0]

    def glance(self, models: Sequence[Sequence[PixelModel]], seed: int, effort: float) -> list[list[Sensor]]:
        """Return what one simulated sensor of each model shows, of as many pixels as the effort allows."""
        amounts = [self.thrift * min(max(effort / self.cost(m), _LEAST), 1.0) for m in models]
        shares = [max(a, least_share(m[0])) for m, a in zip(models, amounts, strict=True)]
        return self.forward.run(models, seed, 1, shares)

    def expect(self, sensors: Sequence[Sensor]) -> Expectation:
        """Return what some simulated sensors, of equally many pixels, let expect."""
        columns = zip(*(s.summaries for s in sensors), strict=True)
        return expectation(self.measured, [add(column) for column in columns], sensors[0].share)

    def changes(
        self, base: Sequence[PixelModel], models: Sequence[Sequence[PixelModel]], seed: int, effort: float
    ) -> Iterator[Change]:
        """Yield for each model how its expected values differ from those of the base model, for two sensors.

        Both are simulated with the same random numbers, and of equally many pixels.
        """
        wanted = self._wanted(models, effort)
        sizes = sorted(set(wanted))
        simulated = self._simulated([*([base] * len(sizes)), *models], [*sizes, *wanted], seed)
        known = dict(zip(sizes, simulated[: len(sizes)], strict=True))
        array = np.array([label.of_array for label in self.measured.labels], dtype=np.bool_)
        for there, size in zip(simulated[len(sizes) :], wanted, strict=True):
            here = known[size]
            pairs = [(self.expect(there[half::2]), self.expect(here[half::2])) for half in range(2)]
            said = [t.said & h.said & ~(t.scatter.few | h.scatter.few) for t, h in pairs]
            halves = np.stack([np.where(k, t.value - h.value, 0.0) for k, (t, h) in zip(said, pairs, strict=True)])
            if there[0].share < 1.0:
                halves[:, array] = 0.0
            yield Change(halves, 0.5 * len(there) * there[0].share)

    def starts(self, model: PixelModel, *, by_eye: bool = True) -> list[list[float]]:
        """Return coordinates of a model's free numbers; of the base pixel perhaps those that the curves may show."""
        own = Guess(model.theta_on, model.theta_off, model.noise_rms, model.corner_hz)
        seen = [guesses(self, s, own) if by_eye else [own] for s in range(self.settings)]
        most = max(len(found) for found in seen)
        return [self._start(model, [found[k if k < len(found) else 0] for found in seen]) for k in range(most)]

    def _stated_dead_time(self, setting: int, otherwise: float) -> float:
        stated = (p.refractory_s for p, s in zip(self.points, self.setting, strict=True) if s == setting)
        return next((dead for dead in stated if np.isfinite(dead)), otherwise)

    def _start(self, model: PixelModel, guessed: Sequence[Guess]) -> list[float]:
        found = []
        for slot in self.base_slots():
            setting = slot.setting or 0
            if slot.free.owner == ALIGNMENT:
                found.append(0.0)
                continue
            if slot.free.owner == "refractory_period":
                value = self._stated_dead_time(setting, model.refractory_s)
            else:
                value = getattr(guessed[setting], slot.free.field)
            found.append(slot.free.coordinate(max(value, slot.free.lowest)))
        own = ((f, f.coordinate(getattr(e, f.field))) for e in model.effects for f in numbers_of(e))
        return [*found, *(self.start_of(f, at) for f, at in own)]
