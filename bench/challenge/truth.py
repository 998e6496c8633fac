"""What a blind station really is, in the names that a diagnosis uses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from bench.models.effects import describe
from bench.station.assembly import bias_map_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from bench.station.bias_map import BiasMap
    from bench.station.schema import WorldSection
    from bench.store import Run

__all__ = ["Number", "Truth", "biases_of"]

#: Name in a diagnosis, quantity of the bias map, unit.
_BASE: Final = (
    ("thresholds.on", "theta_on", "ln"),
    ("thresholds.off", "theta_off", "ln"),
    ("source_follower_bandwidth.corner_hz", "bandwidth_hz", "Hz"),
    ("refractory_period.period_s", "refractory_s", "s"),
)


@dataclass(frozen=True, slots=True)
class Number:
    """A true number."""

    key: str  #: as a diagnosis names it
    value: float
    unit: str


@dataclass(frozen=True, slots=True)
class Truth:
    """What a blind station really is."""

    station: str
    noise_rms: float
    bias_map: BiasMap
    effects: Mapping[str, Mapping[str, float]]  #: parameters by name, by effect

    @classmethod
    def of(cls, station: str, world: WorldSection) -> Truth:
        """Return what the world of a station says."""
        pixel: dict[str, Any] = world.args["pixel"]
        if world.bias_map is None:
            raise ValueError("the world of a challenge has a bias map")
        return cls(station, pixel["noise_rms"], bias_map_of(world.bias_map), pixel["effects"])

    def numbers(self, settings: Sequence[Mapping[str, int]] = ({},)) -> tuple[Number, ...]:
        """Return all true numbers of the pixel.

        Parameters
        ----------
        settings
            Bias offsets, as :func:`biases_of` finds them in runs. Where there are several, thresholds, corner and
            dead time are told of each, with its number behind an ``@``, as a diagnosis does.
        """
        found = [Number("noise_floor.rms", self.noise_rms, "ln")]
        for number, offsets in enumerate(settings):
            at = self.bias_map.settings_at(offsets)
            mark = f"@{number}" if len(settings) > 1 else ""
            found += [Number(key + mark, at[quantity], unit) for key, quantity, unit in _BASE]
        return (*found, *(n for effect in self.effects for n in self._of(effect)))

    def _of(self, effect: str) -> list[Number]:
        units = {p.name: p.unit for p in describe(effect).parameters}
        return [Number(f"{effect}.{name}", value, units[name]) for name, value in self.effects[effect].items()]

    def to_dict(self, settings: Sequence[Mapping[str, int]] = ({},)) -> dict[str, Any]:
        """Return plain values."""
        numbers = {n.key: {"value": n.value, "unit": n.unit} for n in self.numbers(settings)}
        return {"effects": list(self.effects), "parameters": numbers}


def biases_of(runs: Sequence[Run], station: str) -> list[dict[str, int]]:
    """Return the different bias offsets of the points of runs, in the order in which a diagnosis numbers them.

    Raises
    ------
    InputError
        A run was taken on another station.
    """
    from protocols.errors import InputError

    found: list[dict[str, int]] = []
    for run in runs:
        taken_on = (run.header.everything.get("station") or {}).get("name")
        if taken_on != station:
            where = "names no station" if taken_on is None else f"was taken on station {taken_on}"
            raise InputError(f"{run.folder}: {where}; expected a run that was taken on {station}")
        for point in run.points():
            offsets = {name: round(value) for name, value in point.bias.items()}
            if offsets not in found:
                found.append(offsets)
    return found or [{}]
