"""The numbers of a model that are fitted: each with its name, unit, bounds, and the scale on which it moves."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sim_backend.pixel.model import PixelModel

__all__ = ["ALIGNMENT", "DEAD_TIME_KNOWN", "Free", "Scale", "base_parameters", "get", "move", "put", "time_offset"]

#: How a value becomes a coordinate in which what can be measured changes evenly: a spread acts by its square.
Scale = Literal["log", "linear", "square", "inverse"]

#: The camera's clock beside the stimulus: no part of the model, but fitted with it.
ALIGNMENT: Final = "alignment"

#: A stated dead time is believed to this share.
DEAD_TIME_KNOWN: Final = 0.1

_TINY: Final = 1e-12
#: The time offset is no more than so many of its standard deviations.
_MOST_OFFSET: Final = 4.0


@dataclass(frozen=True, slots=True)
class Free:
    """A number of the model that is fitted."""

    owner: str  #: id of the effect, or of a part of the base pixel
    name: str  #: of the parameter
    field: str  #: of the pixel model, or of the effect
    unit: str
    scale: Scale
    lowest: float
    highest: float
    probe: float  #: a value at which the effect can be seen (effects), or a relative step (base)
    prior_sd: float = math.inf  #: how far the coordinate is expected to be from where it starts
    effect: bool = True  #: it belongs to an effect, not to the base pixel

    @property
    def key(self) -> str:
        """Its name in results."""
        return f"{self.owner}.{self.name}"

    @property
    def signed(self) -> bool:
        """Whether it has either sign, and null lies inside its range rather than at its end."""
        return self.lowest < 0.0

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value."""
        if self.scale == "log":
            return math.log(max(value, _TINY))
        if self.scale == "square":
            return value * value
        if self.scale == "inverse":
            return 1.0 / value
        return value

    def value(self, coordinate: float) -> float:
        """Return the value of a coordinate, within the bounds."""
        if self.scale == "log":
            found = math.exp(coordinate)
        elif self.scale == "square":
            found = math.sqrt(max(coordinate, 0.0))
        elif self.scale == "inverse":
            found = 1.0 / coordinate if coordinate > 0.0 else math.inf
        else:
            found = coordinate
        return float(min(max(found, self.lowest), self.highest))

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest coordinate."""
        if self.scale == "inverse":
            return (0.0 if math.isinf(self.highest) else 1.0 / self.highest, 1.0 / max(self.lowest, _TINY))
        return self.coordinate(self.lowest), self.coordinate(self.highest)


def base_parameters(refractory_known: bool) -> tuple[Free, ...]:
    """Return the free numbers of the base pixel; the dead time hardly moves where the settings tell it."""
    return (
        Free("thresholds", "on", "theta_on", "ln", "log", 0.02, 5.0, 0.05, 1.0, False),
        Free("thresholds", "off", "theta_off", "ln", "log", 0.02, 5.0, 0.05, 1.0, False),
        Free("noise_floor", "rms", "noise_rms", "ln", "log", 1e-3, 1.0, 0.12, 1.0, False),
        Free("source_follower_bandwidth", "corner_hz", "corner_hz", "Hz", "log", 0.5, 2e4, 0.15, 1.5, False),
        Free("refractory_period", "period_s", "refractory_s", "s", "log", 1e-6, 1.0, 0.1,
             DEAD_TIME_KNOWN if refractory_known else 2.0, False),
    )  # fmt: skip


def time_offset(sd_s: float) -> Free:
    """Return how much later than the stimulus says the events come, known to be about zero.

    What is later by more is no matter of how clocks are read, and would be taken up here by straight lines that do
    not hold so far: it is an effect.
    """
    most = _MOST_OFFSET * sd_s
    return Free(ALIGNMENT, "time_offset_s", "", "s", "linear", -most, most, sd_s, sd_s, False)


def get(model: PixelModel, free: Free) -> float:
    """Return the value of a number of the model."""
    if not free.effect:
        return float(getattr(model, free.field))
    effect = model.effect(free.owner)
    return float(getattr(effect, free.field))


def put(model: PixelModel, free: Sequence[Free], coordinates: Sequence[float]) -> PixelModel:
    """Return the model with these numbers."""
    base: dict[str, float] = {}
    effects: dict[str, dict[str, float]] = {}
    for one, coordinate in zip(free, coordinates, strict=True):
        if one.owner == ALIGNMENT:
            continue
        target = effects.setdefault(one.owner, {}) if one.effect else base
        target[one.field] = one.value(coordinate)
    changed = tuple(replace(e, **effects[e.id]) if e.id in effects else e for e in model.effects)  # type: ignore[type-var]
    return replace(model, **base, effects=changed)  # type: ignore[arg-type]


def move(free: Free, coordinate: float, share: float = 1.0) -> float:
    """Return another coordinate, so far away that the difference can be seen; inside the bounds."""
    low, high = free.range
    if not free.effect:
        step = free.probe * share
    elif free.scale in ("log",):
        step = 0.3 * share
    else:
        probe = free.coordinate(free.probe)
        step = share * max(0.3 * abs(coordinate), 0.15 * abs(probe))
    return coordinate + step if coordinate + step <= high else max(coordinate - step, low)
