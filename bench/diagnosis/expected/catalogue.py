"""The effects that a model may lack: which of their numbers are fitted, and where they are looked for."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from bench.diagnosis.expected.parameters import Free
from sim_backend.pixel.effects.base import Effect
from sim_backend.pixel.effects.registry import effects
from sim_backend.pixel.hooks import COMPILED

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from bench.diagnosis.expected.parameters import Scale
    from bench.store.data import PointData
    from sim_backend.pixel.model import PixelModel

__all__ = [
    "BENT",
    "DELAYS",
    "NEEDS_KNOWN_THRESHOLDS",
    "OF_ALL_PIXELS",
    "RARE",
    "TWINS",
    "are_the_same",
    "before_readout",
    "candidates",
    "cost_of",
    "details_of",
    "free_of",
    "is_of_few",
    "least_share",
    "least_size",
    "numbers_of",
    "probe_of",
    "sized",
    "switches",
]

#: They are the same as other thresholds (and noise) while those are free.
NEEDS_KNOWN_THRESHOLDS: Final = frozenset({"contrast_error", "injection_offset"})

#: Faults of the bench rather than of the pixel: a pixel that does the same is the more usual reason.
RARE: Final = frozenset({"stray_light", "nd_error", "light_drift", "light_rise_time", "timestamp_jitter"})

#: Effects that do the same to a pixel as another, at one light or at all: where one is thought of, so is the other.
TWINS: Final = {
    "light_drift": "leak",
    "leak": "light_drift",
    "stray_light": "dark_current",
    "dark_current": "stray_light",
    "readout_saturation": "event_rate_limit",
    "event_rate_limit": "readout_saturation",
}

#: Each adds to the photocurrent what the other adds, at any light: no simulation is needed to know that they are the
#: same to a pixel that was not taken behind a shroud or a cap.
_SAME_CURRENT: Final = frozenset({"stray_light", "dark_current"})


def are_the_same(one: str, other: str, points: Sequence[PointData]) -> bool:
    """Return whether two effects do the same, whatever their size, in such points."""
    opened = all(point.attributes.get("ambient", "open") == "open" for point in points)
    return {one, other} == _SAME_CURRENT and opened


#: What is fitted of each effect: name, scale, a value at which it can be seen, the highest that is believed.
_FITTED: Final[dict[str, tuple[tuple[str, Scale, float, float], ...]]] = {
    "contrast_error": (("gain_error", "linear", 0.05, 0.5),),
    "light_rise_time": (("tau_s", "linear", 1e-3, 0.1),),
    "light_drift": (("rate_per_s", "linear", 0.03, 0.5),),
    "light_flicker": (("depth", "square", 0.05, 0.9),),
    "nd_error": (("delta_od", "linear", 0.1, 1.0),),
    "stray_light": (("illuminance_lux", "linear", 0.05, 1e3),),
    "dark_current": (("mean_fa", "linear", 3.0, 1e3),),
    "shot_noise": (("factor", "linear", 1.0, 50.0),),
    "photoreceptor_bandwidth": (("hz_per_fa", "inverse", 5.0, math.inf), ("max_hz", "inverse", 3000.0, math.inf)),
    "low_frequency_noise": (("rms", "square", 0.03, 0.5), ("tau_s", "log", 1.0, 100.0)),
    "high_pass": (("corner_hz", "linear", 0.5, 100.0),),
    "leak": (("rate_per_s", "linear", 0.05, 5.0),),
    "parasitic_photocurrent": (("rate_per_s_per_lux", "linear", 1e-3, 5.0),),
    "reset_noise": (("rms", "square", 0.02, 0.3),),
    "injection_offset": (("offset", "linear", 0.02, 0.3),),
    "threshold_mismatch": (("sigma_on", "square", 0.025, 0.3), ("sigma_off", "square", 0.025, 0.3)),
    "comparator_delay": (("delay_s", "linear", 2e-4, 0.05),),
    "refractory_mismatch": (("spread", "square", 0.3, 2.0),),
    "hot_pixels": (("fraction", "linear", 0.06, 0.5), ("rate_hz", "log", 10.0, 1e4)),
    "crosstalk": (("probability", "linear", 0.02, 0.9),),
    "readout_saturation": (("max_rate_eps", "inverse", 1e5, math.inf),),
    "event_rate_limit": (("max_rate_eps", "inverse", 1e5, math.inf),),
    "timestamp_jitter": (("sigma_s", "linear", 3e-4, 0.05),),
    "trail_filter": (("window_s", "linear", 0.02, 10.0),),
}

#: Numbers of an effect that are what they usually are until the data ask for others: name, scale, the highest that is
#: believed, and values that are tried.
_DETAILS: Final[dict[str, tuple[tuple[str, Scale, float, tuple[float, ...]], ...]]] = {
    "dark_current": (("spread", "square", 2.0, (0.15, 0.3, 0.6)),),
    "leak": (("spread", "square", 2.0, (0.15, 0.3, 0.6)),),
    "readout_saturation": (("fifo_events", "inverse", math.inf, (16.0, 32.0, 64.0, 128.0)),),
    "event_rate_limit": (("period_s", "log", 0.1, (5e-5, 1e-3, 5e-3)),),
}

#: Numbers that make all events later, each by itself; what else they do is little.
DELAYS: Final = frozenset({("comparator_delay", "delay_s")})

#: Numbers along which what is expected goes in bends: a window that is as long as a pulse does all that it can.
BENT: Final = frozenset({("trail_filter", "window_s")})

#: Numbers that only shape what another one switches on.
_SHAPES: Final = frozenset(
    {
        ("photoreceptor_bandwidth", "max_hz"),
        ("low_frequency_noise", "tau_s"),
        ("hot_pixels", "rate_hz"),
    }
)

#: Time that a simulation takes, beside that of the base pixel.
_COST: Final[dict[str, float]] = {
    "light_rise_time": 2.0,
    "light_flicker": 5.0,
    "shot_noise": 3.0,
    "photoreceptor_bandwidth": 3.0,
    "low_frequency_noise": 2.5,
    "high_pass": 2.0,
}
#: How much longer it is with flicker, beside what has more than one low-pass; and what it is with light that rises
#: slowly, beside the same.
_WITH_FLICKER: Final = 2.0
_WITH_RISE: Final = 25.0
_MORE_POLES: Final = frozenset({"shot_noise", "photoreceptor_bandwidth", "low_frequency_noise"})
#: Functions that are called for single samples; and an effect of a user's own that has none.
_COST_OF_HOOKS: Final = 500.0
_COST_OF_A_USER: Final = 30.0


def cost_of(model: PixelModel) -> float:
    """Return about how long the model takes beside the base pixel."""
    ids = [e.id for e in model.effects]
    cost = max((_cost_of_one(e) for e in model.effects), default=1.0)
    if _MORE_POLES.isdisjoint(ids):
        return cost
    if "light_rise_time" in ids:
        return max(cost, _WITH_RISE)
    return cost * _WITH_FLICKER if "light_flicker" in ids else cost


def _cost_of_one(effect: Effect) -> float:
    if effect.id in _FITTED:
        return _COST.get(effect.id, 1.0)
    return _COST_OF_A_USER if set(COMPILED).isdisjoint(effect.hooks()) else _COST_OF_HOOKS


def least_share(model: PixelModel) -> float:
    """Return the part of the pixels that tells a model at the least.

    It is all of them where the model shows in what pixels do to each other, and many where it is in few pixels.
    """
    if any(_couples_pixels(e) for e in model.effects):
        return 1.0
    return _MANY if any(is_of_few(e.id) for e in model.effects) else 0.0


def before_readout(model: PixelModel) -> PixelModel:
    """Return the model without what happens to events behind the comparators."""
    return replace(model, effects=tuple(e for e in model.effects if e.id not in _OF_READOUT))


def is_of_few(effect_id: str) -> bool:
    """Return whether only few pixels have an effect."""
    return effect_id in _OF_FEW


def least_size(effect: type[Effect], least: float) -> float:
    """Return the least size at which to look for an effect, beside that of the catalogue; of most it is `least`.

    How many pixels have it is a straight line: of a smaller share of them there may be none among those simulated.
    """
    return 1.0 if is_of_few(effect.id) else least


def _couples_pixels(effect: Effect) -> bool:
    """Return whether pixels know of each other: a user's effect does not if it is made of functions of a pixel."""
    if effect.id in _FITTED:
        return effect.id in _OF_ARRAY
    return type(effect).apply is not Effect.apply or not set(effect.hooks()) <= {*COMPILED, "light"}


#: Light, or a level, that never rests.
_RESTLESS: Final = frozenset({"light_drift", "light_flicker", "high_pass"})


def _takes_hours(ids: Collection[str]) -> bool:
    """Return whether effects together go sample by sample, hundreds of times as slow: they are not looked for so."""
    return "light_rise_time" in ids and not _RESTLESS.isdisjoint(ids) and not _MORE_POLES.isdisjoint(ids)


#: Effects of all pixels together: a part of them does not show them.
OF_ALL_PIXELS: Final = frozenset({"readout_saturation", "event_rate_limit"})
#: Effects that couple pixels.
_OF_ARRAY: Final = OF_ALL_PIXELS | {"crosstalk"}
#: Effects that leave the comparators' events as they are, and change what becomes of them.
_OF_READOUT: Final = _OF_ARRAY | {"hot_pixels", "timestamp_jitter", "trail_filter"}
#: Few pixels have it: among less than a quarter of them there may be none, even of a share that is well seen.
_OF_FEW: Final = frozenset({"hot_pixels"})
_MANY: Final = 0.25


def free_of(effect: type[Effect]) -> tuple[Free, ...]:
    """Return the numbers of an effect that are fitted.

    Of an effect that is not in the table, a user's own, those that have a null of zero or infinity are fitted, from
    their default.
    """
    described = {p.name: p for p in effect.parameters()}
    return tuple(
        Free(
            effect.id,
            name,
            name,
            described[name].unit,
            scale,
            max(described[name].bounds[0], -highest),
            highest,
            probe,
        )
        for name, scale, probe, highest in _FITTED.get(effect.id) or _of_a_user(effect)
    )


def _of_a_user(effect: type[Effect]) -> tuple[tuple[str, Scale, float, float], ...]:
    return tuple(
        (p.name, "inverse" if math.isinf(p.null) else "linear", p.default, p.bounds[1])
        for p in effect.parameters()
        if p.null in (0.0, math.inf) and p.default is not None and p.default != p.null
    )


def details_of(effect: type[Effect]) -> tuple[tuple[Free, tuple[float, ...]], ...]:
    """Return numbers that are fitted once the data ask for another value than the usual one, and values to try."""
    known = {p.name: p for p in effect.parameters()}
    return tuple(
        (Free(effect.id, name, name, known[name].unit, scale, known[name].bounds[0], highest, tries[-1]), tries)
        for name, scale, highest, tries in _DETAILS.get(effect.id, ())
    )


def numbers_of(effect: Effect) -> tuple[Free, ...]:
    """Return the numbers of an effect of a model that are fitted, with the details that are not the usual ones."""
    usual = {p.name: p.default for p in effect.parameters()}
    details = (free for free, _ in details_of(type(effect)))
    return (*free_of(type(effect)), *(f for f in details if getattr(effect, f.field) != usual[f.name]))


def switches(effect: type[Effect]) -> tuple[Free, ...]:
    """Return the numbers that switch an effect on; the others only shape it."""
    return tuple(f for f in free_of(effect) if (effect.id, f.name) not in _SHAPES)


def probe_of(
    effect: type[Effect], at: Mapping[str, float] | None = None, given: Mapping[str, float] | None = None
) -> Effect:
    """Return the effect at the values at which it can be seen, or `at` others.

    Parameters
    ----------
    given
        What the data show by eye: numbers that are not fitted, and where to look for those that shape it.
    """
    usual = {f.name: f.probe for f in free_of(effect)}
    return effect(**{**usual, **(given or {}), **(at or {})})


def sized(effect: type[Effect], factor: float, given: Mapping[str, float] | None = None) -> Effect:
    """Return the effect at so many times the catalogue's coordinates, within the bounds; see :func:`probe_of`."""
    free = switches(effect)
    at = {f.name: f.value(min(max(factor * f.coordinate(f.probe), f.range[0]), f.range[1])) for f in free}
    return probe_of(effect, at, given)


def candidates(
    model: PixelModel, points: Sequence[PointData], without: Collection[str] = ()
) -> list[type[Effect]]:  # fmt: skip
    """Return the effects that the model lacks and that may show in these points; those in `without` are left out."""
    return [e for e in effects().values() if e.id not in without and why_not(e, model, points) is None]


def why_not(effect: type[Effect], model: PixelModel, points: Sequence[PointData]) -> str | None:
    """Return why an effect cannot be looked for in these points, beside a model; None: it can."""
    if model.effect(effect.id) is not None:
        return "the model has it already"
    if not free_of(effect):
        return "none of its numbers has a null of 0, or infinity, and another default, where it is looked for"
    if effect.id in NEEDS_KNOWN_THRESHOLDS:
        return "other thresholds do the same, and they are fitted"
    if effect.id == "nd_error" and not any(p.nd_od > 0.0 for p in points):
        return "no filter was in the light"
    if effect.id == "nd_error" and not any(e.knows_light for e in model.effects):
        return "nothing in the model depends on how much light there is"
    if effect.id in OF_ALL_PIXELS and any(p.stored_roi is not None for p in points):
        return "it shows in the whole window, of which a part is looked at (--whole looks at all of it)"
    if _takes_hours([effect.id, *(e.id for e in model.effects)]):
        return "beside what the model has it is simulated sample by sample, for hours"
    return None
