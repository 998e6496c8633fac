"""The pixel model: the base pixel, which is always there, and the effects that are added to it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

from protocols.errors import InputError
from sim_backend.pixel.effects.base import STAGES, Effect
from sim_backend.pixel.effects.registry import effect_from_dict
from sim_backend.pixel.parameters import Described, parameter, refuse_unknown

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["Photoconversion", "PixelModel"]

_ELEMENTARY_CHARGE_C: Final = 1.602176634e-19
_FA_PER_A: Final = 1e15


@dataclass(frozen=True, slots=True)
class Photoconversion(Described):
    """From illuminance to photocurrent: ``I = k E`` with ``k = photons_per_lux * eta * q * pitch^2``.

    42.4 fA/lux times eta at a pitch of 4.86 um.
    """

    eta: float = parameter("1", (1e-6, 1.0), 0.6, None, "quantum efficiency, averaged over the light's spectrum")
    pitch_m: float = parameter("m", (1e-7, 1e-3), 4.86e-6, None, "distance of two pixels")
    photons_per_lux: float = parameter("1/(lx m2 s)", (1e14, 1e18), 1.12e16, None, "photon flux at one lux")

    def __post_init__(self) -> None:
        self.check_bounds("photoconversion")

    @property
    def gain_fa_per_lux(self) -> float:
        """Photocurrent at one lux, fA."""
        return self.photons_per_lux * self.eta * _ELEMENTARY_CHARGE_C * self.pitch_m**2 * _FA_PER_A


@dataclass(frozen=True, slots=True)
class PixelModel(Described):
    """A base pixel and the effects that it has.

    ``model + DarkCurrent(mean_fa=5.0)`` is the same pixel with one effect more. An effect at its null value changes
    nothing, so the model without it is nested in the model with it. The effects are kept in the order in which a
    signal passes them, whatever the order in which they were added.
    """

    photoconversion: Photoconversion = field(default_factory=Photoconversion)
    noise_rms: float = parameter("ln", (0.0, 1.0), 0.03, 0.0, "rms of the noise behind the source follower")
    corner_hz: float = parameter("Hz", (0.01, 1e6), 200.0, None, "corner of the source follower's low-pass")
    theta_on: float = parameter("ln", (0.01, 5.0), 0.3, None, "ON threshold")
    theta_off: float = parameter("ln", (0.01, 5.0), 0.3, None, "OFF threshold")
    refractory_s: float = parameter("s", (0.0, 10.0), 1e-3, 0.0, "dead time after an event")
    effects: tuple[Effect, ...] = ()

    def __post_init__(self) -> None:
        self.check_bounds("pixel model")
        ids = [e.id for e in self.effects]
        repeated = sorted({i for i in ids if ids.count(i) > 1})
        if repeated:
            raise InputError(*(f"pixel model: effect {i} is there more than once; expected once" for i in repeated))
        in_order = tuple(sorted(self.effects, key=lambda e: (STAGES.index(e.stage), e.id)))
        object.__setattr__(self, "effects", in_order)

    def __add__(self, effect: Effect) -> PixelModel:
        """Return this model with one effect more."""
        if not isinstance(effect, Effect):
            return NotImplemented
        return replace(self, effects=(*self.effects, effect))

    def without(self, effect_id: str) -> PixelModel:
        """Return this model without the effect of that id; the same if it has none."""
        return replace(self, effects=tuple(e for e in self.effects if e.id != effect_id))

    def changed(self, effect: Effect) -> PixelModel:
        """Return this model with an effect in the place of the one that has its id."""
        return replace(self, effects=tuple(effect if e.id == effect.id else e for e in self.effects))

    def effect(self, effect_id: str) -> Effect | None:
        """Return the effect of that id, or None."""
        return next((e for e in self.effects if e.id == effect_id), None)

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and texts, as they may stand in a YAML file."""
        return {
            "photoconversion": self.photoconversion.values(),
            **self.values(),
            "effects": {e.id: e.values() for e in self.effects},
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> PixelModel:
        """Return the model that :meth:`to_dict` wrote; what is not named has its default.

        Raises
        ------
        InputError
            A key or an effect is unknown, or a value out of bounds.
        """
        rest = dict(data)
        conversion = _section(rest.pop("photoconversion", {}), "photoconversion")
        effects = _section(rest.pop("effects", {}), "effects")
        refuse_unknown("photoconversion", conversion, Photoconversion)
        refuse_unknown("pixel model", rest, cls)
        return cls(
            photoconversion=Photoconversion(**conversion),
            effects=tuple(effect_from_dict(i, _section(v, f"effect {i}")) for i, v in effects.items()),
            **rest,
        )


def _section(value: object, name: str) -> dict[str, Any]:
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise InputError(f"pixel model: {name} is {value!r}; expected names with values")
    return dict(value)
