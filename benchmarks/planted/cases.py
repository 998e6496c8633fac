"""What is planted: for each case a pixel with none, one or several effects, and the run that is taken of it."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from bench.diagnosis.expected.catalogue import NEEDS_KNOWN_THRESHOLDS, free_of, switches
from benchmarks.planted.strange_effects import STRANGE
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects.registry import effect_from_dict, effects

if TYPE_CHECKING:
    from bench.diagnosis.expected.parameters import Free
    from sim_backend.pixel.effects import Effect

__all__ = ["KINDS", "Case", "Kind", "Plan", "cases", "dozen", "known_effects", "plantable"]

Kind = Literal["single", "several", "none", "outside"]
KINDS: Final[dict[Kind, int]] = {"single": 126, "several": 60, "none": 60, "outside": 60}

#: Steps at which the reference engine looks, s. No whole number of microseconds, so that the time stamps do not tell
#: them: the model then looks at another step than the one that made the data.
_OTHER_STEPS_S: Final = (13.7e-6, 6.7e-6)
_STEP_S: Final = 1e-5
#: What needs hooks is known to the reference engine alone, which is slow there: longer steps, fewer points.
_SLOW_STEP_S: Final = 17.3e-6
#: Of so many cases one is made by the reference engine.
_EVERY: Final = 3

#: Invisible by itself: without anything that depends on the absolute light, an error of the filter is no contrast.
_NOT_ALONE: Final = frozenset({"nd_error"})
#: The same at the pixel: two of them in one run are one effect.
_ALIKE: Final = (frozenset({"dark_current", "stray_light"}), frozenset({"leak", "light_drift"}))

#: Sizes that are aimed at, in standard errors: from invisible to well seen; of several at once each is to be seen.
_SIZES: Final[dict[Kind, tuple[float, float]]] = {
    "single": (0.7, 100.0), "several": (8.0, 80.0), "outside": (4.0, 100.0),
}  # fmt: skip
#: In every second case effects are gross instead: up to so many times the catalogue's probe.
_GROSS_FROM: Final = 30.0
_GROSS_TO: Final = 1.5

#: Size of each effect at the catalogue's probe, in standard errors, in the runs of this study (median of pixels).
_AT_PROBE: Final[dict[str, float]] = {
    "comparator_delay": 230.0, "crosstalk": 620.0, "dark_current": 1250.0, "event_rate_limit": 400.0,
    "high_pass": 200.0,
    "hot_pixels": 60.0, "leak": 80.0, "light_drift": 320.0, "light_flicker": 120.0, "light_rise_time": 5000.0,
    "low_frequency_noise": 15.0, "nd_error": 60.0, "parasitic_photocurrent": 190.0, "photoreceptor_bandwidth": 5000.0,
    "readout_saturation": 50.0, "refractory_mismatch": 170.0, "reset_noise": 100.0, "shot_noise": 2000.0,
    "stray_light": 400.0, "threshold_mismatch": 35.0, "timestamp_jitter": 3000.0, "trail_filter": 10.0,
    "light_dead_time": 60.0, "rebound": 380.0, "gain_drift": 300.0,
}  # fmt: skip
_USUAL: Final = 50.0
#: Where size does not go with the first number of the catalogue: the number that it goes with, and a value.
_ACTS: Final[dict[str, tuple[str, float]]] = {"hot_pixels": ("rate_hz", 1.0)}
#: What an effect of this study never exceeds, where the catalogue's highest is no pixel that anybody would measure.
_MOST: Final[dict[str, float]] = {
    "dark_current": 40.0, "stray_light": 2.0, "shot_noise": 10.0, "light_rise_time": 0.01, "light_drift": 0.3,
    "light_flicker": 0.4, "leak": 1.0, "parasitic_photocurrent": 0.02, "high_pass": 10.0, "reset_noise": 0.08,
    "low_frequency_noise": 0.15, "threshold_mismatch": 0.08, "comparator_delay": 5e-3, "refractory_mismatch": 1.0,
    "hot_pixels": 200.0, "crosstalk": 0.3, "timestamp_jitter": 5e-3, "trail_filter": 0.2, "nd_error": 0.5,
    "light_dead_time": 1e3, "telegraph_thresholds": 0.5, "rebound": 0.5, "gain_drift": 0.5, "bright_noise": 30.0,
    "compression": 10.0, "polarity_error": 0.3, "dead_frames": 0.5,
}  # fmt: skip
#: A faster corner, or readout, is none; a slower one leaves nothing to measure.
_LEAST: Final[dict[str, float]] = {
    "photoreceptor_bandwidth": 0.5,
    "readout_saturation": 8e3,
    "event_rate_limit": 1e4,
}


@dataclass(frozen=True, slots=True)
class Plan:
    """The points of a run: constant light and square waves of two widths."""

    levels_lux: tuple[float, ...]  #: on chip; ND 3.0 is in at the two dimmest
    long: tuple[float, ...]  #: log contrasts of the wide pulses
    short: tuple[float, ...]  #: of the narrow ones
    long_s: float = 0.0805
    short_s: float = 0.0205
    long_periods: int = 12
    short_periods: int = 20
    constant_s: float = 6.0

    @property
    def points(self) -> int:
        """Number of points."""
        return len(self.levels_lux) * (1 + len(self.long) + len(self.short))


@dataclass(frozen=True, slots=True)
class Case:
    """One run whose truth is known."""

    kind: Kind
    number: int  #: among those of its kind
    seed: int
    model: PixelModel  #: the truth
    left_out: tuple[str, ...]  #: effects that the diagnosis is not told of
    reference: bool  #: made by the reference engine, not by the fast one
    dt_s: float
    plan: Plan

    @property
    def name(self) -> str:
        """What it is called in files; it does not tell what is planted."""
        return f"{self.kind}-{self.number:03d}"

    @property
    def planted(self) -> tuple[str, ...]:
        """Ids of the effects."""
        return tuple(e.id for e in self.model.effects)

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and texts: the truth."""
        return {
            "kind": self.kind,
            "seed": self.seed,
            "model": self.model.to_dict(),
            "left_out": list(self.left_out),
            "engine": "reference" if self.reference else "fast",
            "dt_s": self.dt_s,
            "points": self.plan.points,
            "plan": asdict(self.plan),
        }


#: Effects of which the diagnosis fits a number, and that are planted in sizes that go with its square.
_OF_SQUARE: Final = frozenset({"timestamp_jitter"})

#: The more levels, the fewer contrasts: 36 to 40 points.
_PLANS: Final = (
    Plan((0.08, 1.0, 100.0), (0.1, 0.2, 0.25, 0.3, 0.4, 0.6, 1.0), (0.25, 0.35, 0.5, 1.0)),
    Plan((0.08, 0.3, 3.0, 100.0), (0.15, 0.22, 0.3, 0.4, 0.6, 1.0), (0.3, 0.45, 1.0)),
    Plan((0.08, 0.3, 1.0, 10.0, 100.0), (0.2, 0.28, 0.36, 0.5, 1.0), (0.35, 0.7)),
)
_SHORT_PLAN: Final = Plan(
    (0.08, 1.0, 100.0), (0.2, 0.28, 0.36, 0.5, 1.0), (0.35, 0.7), long_periods=8, short_periods=16, constant_s=4.0
)


def known_effects() -> dict[str, type[Effect]]:
    """Return all effects by id: the built-in ones, and those that no built-in can express."""
    return {**effects(), **{e.id: e for e in STRANGE}}


def plantable() -> tuple[str, ...]:
    """Return the ids of the catalogue's effects that can show by themselves in such runs."""
    hidden = NEEDS_KNOWN_THRESHOLDS | _NOT_ALONE | {e.id for e in STRANGE}
    return tuple(sorted(i for i, e in effects().items() if i not in hidden and free_of(e)))


def cases(seed: int = 1, counts: dict[Kind, int] | None = None) -> list[Case]:
    """Return the cases of the study: the same for the same seed, and each independent of how many there are.

    Parameters
    ----------
    counts
        Number of cases of each kind; default is :data:`KINDS`.
    """
    wanted = counts or KINDS
    return [_case(kind, number, seed) for kind, count in wanted.items() for number in range(count)]


def dozen() -> list[Case]:
    """Return the fixed dozen that is tried with all tests: gross effects, each by itself, and nothing at all."""
    usual = PixelModel(theta_on=0.32, theta_off=0.26, noise_rms=0.042, corner_hz=150.0, refractory_s=4e-3)
    other = PixelModel(theta_on=0.24, theta_off=0.3, noise_rms=0.03, corner_hz=300.0, refractory_s=2e-3)
    found = []
    for number, planted in enumerate(_DOZEN):
        model = usual if number % 2 else other
        for effect_id, values in planted.items():
            model = model + effect_from_dict(effect_id, values)
        kind: Kind = "none" if not planted else "single" if len(planted) == 1 else "several"
        reference = number % _EVERY == _EVERY - 1
        step = _OTHER_STEPS_S[0] if reference else _STEP_S
        found.append(Case(kind, number, 1000 + number, model, (), reference, step, _SHORT_PLAN))
    return found


_DOZEN: Final[tuple[dict[str, dict[str, float]], ...]] = (
    {},
    {"dark_current": {"mean_fa": 6.0}},
    {"leak": {"rate_per_s": 0.1}},
    {"threshold_mismatch": {"sigma_on": 0.03, "sigma_off": 0.03}},
    {"photoreceptor_bandwidth": {"hz_per_fa": 3.0, "max_hz": 3000.0}},
    {"shot_noise": {"factor": 2.0}},
    {"reset_noise": {"rms": 0.03}},
    {"crosstalk": {"probability": 0.03}},
    {},
    {"timestamp_jitter": {"sigma_s": 1e-3}},
    {"refractory_mismatch": {"spread": 0.5}},
    {"dark_current": {"mean_fa": 6.0}, "leak": {"rate_per_s": 0.1}},
)


def _case(kind: Kind, number: int, seed: int) -> Case:
    own = np.random.SeedSequence((seed, list(KINDS).index(kind), number))
    rng = np.random.default_rng(own)
    model = _base(rng)
    left_out: tuple[str, ...] = ()
    for one in _chosen(kind, number, rng):
        model = model + _sized(one, _aim(kind, one, rng), rng)
        left_out = (one,) if kind == "outside" else ()
    plan = _PLANS[int(rng.integers(len(_PLANS)))]
    turn = number // _EVERY
    reference, step = number % _EVERY == _EVERY - 1, _OTHER_STEPS_S[turn % len(_OTHER_STEPS_S)]
    if any(e.hooks() for e in model.effects):
        reference, step, plan = True, _SLOW_STEP_S, _SHORT_PLAN
    return Case(
        kind, number, int(own.generate_state(1)[0]), model, left_out, reference, step if reference else _STEP_S, plan
    )


def _aim(kind: Kind, effect_id: str, rng: np.random.Generator) -> float:
    """Return the size that is aimed at, in standard errors."""
    low, high = _SIZES[kind]
    gross = _GROSS_TO * _AT_PROBE.get(effect_id, _USUAL)
    if gross > high and rng.random() < 0.5:
        low, high = _GROSS_FROM, gross
    return _log_uniform(rng, low, high)


def _base(rng: np.random.Generator) -> PixelModel:
    on, off = rng.uniform(0.2, 0.4, 2)
    return PixelModel(
        theta_on=round(float(on), 4),
        theta_off=round(float(off), 4),
        noise_rms=round(float(rng.uniform(0.02, min(0.06, min(on, off) / 4.5))), 4),
        corner_hz=round(_log_uniform(rng, 60.0, 400.0), 1),
        refractory_s=round(_log_uniform(rng, 1e-3, 1e-2), 4),
    )


def _chosen(kind: Kind, number: int, rng: np.random.Generator) -> list[str]:
    """Return the effects of a case: each comes up equally often where there is one."""
    known = plantable()
    if kind == "none":
        return []
    if kind == "single":
        return [known[number % len(known)]]
    if kind == "outside":
        strange = [e.id for e in STRANGE]
        # Two in five are effects that no built-in can express.
        fifth, turn = divmod(number, 5)
        return [strange[(2 * fifth + turn) % len(strange)] if turn < 2 else known[(3 * fifth + turn) % len(known)]]
    return _several(rng, 2 if number % 3 else 3)


def _several(rng: np.random.Generator, count: int) -> list[str]:
    while True:
        found = [str(i) for i in rng.choice(plantable(), count, replace=False)]
        if not any(alike <= set(found) for alike in _ALIKE):
            return found


def _sized(effect_id: str, size: float, rng: np.random.Generator) -> Effect:
    """Return an effect of about this size, in standard errors, for a usual pixel of this study."""
    cls = known_effects()[effect_id]
    free = free_of(cls)
    factor = size / _AT_PROBE.get(effect_id, _USUAL)
    if effect_id in _OF_SQUARE:
        factor = math.sqrt(factor)
    if effect_id in _ACTS:
        name, at = _ACTS[effect_id]
        mine = next(f for f in free if f.name == name)
        values = {f.name: f.probe for f in free} | {name: min(at * factor, _MOST[effect_id], mine.highest)}
    else:
        values = {f.name: _scaled(f, factor) for f in switches(cls)}
    values |= _shape(effect_id, rng)
    if effect_id == "light_drift" and rng.random() < 0.5:
        values["rate_per_s"] *= -1.0
    return cls(**{name: _rounded(value) for name, value in values.items()})


def _scaled(free: Free, factor: float) -> float:
    """Return the value whose coordinate is `factor` times that of the probe: what can be measured goes with it."""
    value = free.value(free.coordinate(free.probe) * factor)
    most = min(_MOST.get(free.owner, math.inf), 0.9 * free.highest)
    return max(min(value, most), _LEAST.get(free.owner, free.lowest))


def _shape(effect_id: str, rng: np.random.Generator) -> dict[str, float]:
    """Return the numbers that shape an effect and do not switch it on."""
    if effect_id == "light_flicker":
        return {"frequency_hz": _log_uniform(rng, 40.0, 300.0)}
    if effect_id == "low_frequency_noise":
        return {"tau_s": _log_uniform(rng, 0.2, 3.0)}
    if effect_id == "hot_pixels":
        return {"fraction": float(rng.uniform(0.015, 0.04))}
    return {}


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")
