"""Effects by id: those that are shipped, those of installed plug-ins, and those of files that a user named."""

from __future__ import annotations

import inspect
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from protocols.errors import InputError
from protocols.user_module import sha256_of
from sim_backend.pixel.effects.base import Effect
from sim_backend.pixel.effects.comparator_delay import ComparatorDelay
from sim_backend.pixel.effects.contrast_error import ContrastError
from sim_backend.pixel.effects.crosstalk import Crosstalk
from sim_backend.pixel.effects.dark_current import DarkCurrent
from sim_backend.pixel.effects.event_rate_limit import EventRateLimit
from sim_backend.pixel.effects.high_pass import HighPass
from sim_backend.pixel.effects.hot_pixels import HotPixels
from sim_backend.pixel.effects.injection_offset import InjectionOffset
from sim_backend.pixel.effects.leak import Leak
from sim_backend.pixel.effects.light_drift import LightDrift
from sim_backend.pixel.effects.light_flicker import LightFlicker
from sim_backend.pixel.effects.light_rise_time import LightRiseTime
from sim_backend.pixel.effects.low_frequency_noise import LowFrequencyNoise
from sim_backend.pixel.effects.nd_error import NdError
from sim_backend.pixel.effects.parasitic_photocurrent import ParasiticPhotocurrent
from sim_backend.pixel.effects.photoreceptor_bandwidth import PhotoreceptorBandwidth
from sim_backend.pixel.effects.readout_saturation import ReadoutSaturation
from sim_backend.pixel.effects.refractory_mismatch import RefractoryMismatch
from sim_backend.pixel.effects.reset_noise import ResetNoise
from sim_backend.pixel.effects.shot_noise import ShotNoise
from sim_backend.pixel.effects.stray_light import StrayLight
from sim_backend.pixel.effects.threshold_mismatch import ThresholdMismatch
from sim_backend.pixel.effects.timestamp_jitter import TimestampJitter
from sim_backend.pixel.effects.trail_filter import TrailFilter
from sim_backend.pixel.effects.user_file import EffectSource, check_effect_class, read_effect_file
from sim_backend.pixel.parameters import refuse_unknown, unknown_name

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Mapping
    from importlib.metadata import EntryPoint

__all__ = [
    "GROUP",
    "effect_class",
    "effect_from_dict",
    "effect_source",
    "effects",
    "forget_effect_files",
    "load_effect_files",
    "loaded_effect_files",
]

#: Entry-point group of effects that other distributions bring.
GROUP: Final = "evs_bench.effects"

#: In the order in which a signal passes them.
_SHIPPED: Final[tuple[type[Effect], ...]] = (
    ContrastError,
    LightRiseTime,
    LightDrift,
    LightFlicker,
    NdError,
    StrayLight,
    DarkCurrent,
    ShotNoise,
    PhotoreceptorBandwidth,
    LowFrequencyNoise,
    HighPass,
    Leak,
    ParasiticPhotocurrent,
    ResetNoise,
    InjectionOffset,
    ThresholdMismatch,
    ComparatorDelay,
    RefractoryMismatch,
    HotPixels,
    Crosstalk,
    ReadoutSaturation,
    TimestampJitter,
    TrailFilter,
    EventRateLimit,
)


#: Files that were loaded, by their full path.
_FILES: Final[dict[Path, EffectSource]] = {}


def effects() -> dict[str, type[Effect]]:
    """Return all known effects by id.

    Raises
    ------
    InputError
        A plug-in cannot be imported, brings something that is no effect, or an id that is taken.
    """
    sources = (*_plug_ins(), *_FILES.values())
    return {cls.id: cls for cls in (*_SHIPPED, *(cls for source in sources for cls in source.classes))}


def load_effect_files(paths: Iterable[str | os.PathLike[str]]) -> tuple[EffectSource, ...]:
    """Make the effects of a user's own files known, and return what was found in them.

    A file that is loaded already is left alone; one that has changed since takes the place of what it was. A process
    that is spawned knows none of them: call this there with each `path` of :func:`loaded_effect_files`.

    Raises
    ------
    InputError
        A file cannot be used, or an id is taken; one line with file and line. Earlier files stay loaded.
    """
    return tuple(_load(path) for path in paths)


def loaded_effect_files() -> tuple[EffectSource, ...]:
    """Return the files that are loaded, in the order in which they were."""
    return tuple(_FILES.values())


def forget_effect_files() -> None:
    """Make the effects of all files unknown again; models that have them keep them."""
    _FILES.clear()


def effect_source(effect_id: str) -> EffectSource | None:
    """Return where the effect of that id came from; None if it is built in, or there is none."""
    return next((s for s in (*_plug_ins(), *_FILES.values()) if effect_id in s.ids), None)


def _load(path: str | os.PathLike[str]) -> EffectSource:
    where = Path(path).resolve()
    loaded = _FILES.get(where)
    if loaded is not None and where.is_file() and sha256_of(where) == loaded.sha256:
        return loaded
    found = read_effect_file(path)
    others = {c.id: f"of {s.name}" for key, s in _FILES.items() if key != where for c in s.classes}
    others |= {c.id: f"of {s.package}" for s in _plug_ins() for c in s.classes}
    others |= {c.id: "built in" for c in _SHIPPED}
    _refuse_taken(f"{path}", found.ids, others)
    _FILES[where] = found
    return found


def _refuse_taken(owner: str, ids: Iterable[str], others: Mapping[str, str]) -> None:
    taken = dict(others)
    for effect_id in ids:
        if effect_id in taken:
            raise InputError(f"{owner}: the id {effect_id} is taken ({taken[effect_id]}); choose another")
        taken[effect_id] = "twice in it"


@cache
def _plug_ins() -> tuple[EffectSource, ...]:
    """Return the effects of installed plug-ins."""
    taken = {cls.id: "built in" for cls in _SHIPPED}
    found = []
    for point in entry_points(group=GROUP):
        source = _plug_in(point)
        _refuse_taken(f"plug-in {point.name} ({point.value})", source.ids, taken)
        taken |= dict.fromkeys(source.ids, f"of {source.package}")
        found.append(source)
    return tuple(found)


def _plug_in(point: EntryPoint) -> EffectSource:
    owner = f"plug-in {point.name} ({point.value})"
    try:
        cls = point.load()
    except (ImportError, AttributeError) as error:
        raise InputError(f"{owner}: cannot be imported: {error}") from error
    if not (isinstance(cls, type) and issubclass(cls, Effect)):
        raise InputError(f"{owner}: expected a class derived from Effect")
    check_effect_class(cls, owner)
    file = inspect.getsourcefile(cls)
    package = f"{point.dist.name} {point.dist.version}" if point.dist else point.value.partition(":")[0]
    return EffectSource(point.name, "entry point", sha256_of(Path(file)) if file else "", (cls,), package)


def effect_class(effect_id: str) -> type[Effect]:
    """Return the effect of that id.

    Raises
    ------
    InputError
        There is none; the message names the nearest.
    """
    known = effects()
    if effect_id not in known:
        own = "; an effect of your own is known once its file is named with --effects"
        raise InputError(unknown_name("effect", effect_id, known) + own)
    return known[effect_id]


def effect_from_dict(effect_id: str, values: Mapping[str, Any]) -> Effect:
    """Return the effect of that id with these parameters; those that are not named have their default.

    Raises
    ------
    InputError
        The id or a parameter is unknown, or a value out of bounds.
    """
    cls = effect_class(effect_id)
    refuse_unknown(f"effect {effect_id}", values, cls)
    return cls(**values)
