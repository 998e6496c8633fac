"""One seeded world: a light source, an ND filter, the light on the chip, its pixels, and the time they live in.

The simulated devices are the ports of this world. What a device is told changes the world at that moment of its
virtual clock; what a camera records is computed from what the world remembers. Nothing here knows a station file or
a protocol: what the operator *believes* of the bench stands in the station's calibration, what is *true* stands here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, get_args

import numpy as np

from drivers.interfaces import World
from protocols.errors import InputError
from protocols.points import Ambient
from sim_backend.clock import NS_PER_S, VirtualClock
from sim_backend.pixel.light import LightHistory
from sim_backend.pixel.model import PixelModel

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["Ambient", "OpticalBench", "TriggerEdge"]

_AMBIENTS: Final = get_args(Ambient)


@dataclass(frozen=True, slots=True)
class TriggerEdge:
    """An edge on the wire from the light source to the camera's trigger input."""

    time_ns: int
    rising: bool


class OpticalBench(World):
    """Light x ND filter -> illuminance -> pixels, with a clock and a temperature.

    The illuminance on the chip is ``level * lux_per_level * transmission + ambient``, with the source's rise time.
    What else happens to the light, and all that happens in the pixel, are effects of the pixel model.

    Parameters
    ----------
    lux_per_level
        True illuminance on the chip per unit of the source's level, without a filter, lux.
    pixel
        The pixel, as :meth:`sim_backend.pixel.model.PixelModel.from_dict` reads it.
    sensor_seed
        Stands for the individual sensor: fixes what differs from pixel to pixel. 0 to 2^64 - 1.
    temperature_c
        Temperature of the sensor, degrees Celsius.
    ambient_lux
        Light of the room on the chip, past source and filter, lux. It acts only while `ambient` is "open".
    ambient
        "open", "shrouded" (no light of the room) or "capped" (no light at all), until a recording says otherwise.
    nd_error_od
        For filters by name: what their optical density is above the nominal one.
    trigger_cable
        Whether a cable leads from the source to the camera's trigger input.

    Raises
    ------
    InputError
        An argument is out of range.
    """

    def __init__(
        self,
        *,
        lux_per_level: float,
        pixel: Mapping[str, Any],
        sensor_seed: int,
        temperature_c: float = 25.0,
        ambient_lux: float = 0.0,
        ambient: Ambient = "open",
        nd_error_od: Mapping[str, float] | None = None,
        trigger_cable: bool = True,
    ) -> None:
        _require(0.0 < lux_per_level < math.inf, "lux_per_level", lux_per_level, "more than 0 lux")
        _require(0.0 <= ambient_lux < math.inf, "ambient_lux", ambient_lux, "0 lux or more")
        _require(ambient in _AMBIENTS, "ambient", ambient, " or ".join(_AMBIENTS))
        _require(type(sensor_seed) is int and 0 <= sensor_seed < 1 << 64, "sensor_seed", sensor_seed, "0 to 2^64 - 1")
        _require(-273.15 < temperature_c < math.inf, "temperature_c", temperature_c, "degrees Celsius")
        for name, delta_od in (nd_error_od or {}).items():
            _require(-10.0 < delta_od < 10.0, f"nd_error_od of {name}", delta_od, "-10 to 10")
        self.clock = VirtualClock()
        self.pixel = PixelModel.from_dict(pixel)
        self.sensor_seed = sensor_seed
        self.temperature_c = temperature_c
        self.rise_tau_s = 0.0  #: time constant of the source's edges, s; the light source sets it when it connects
        self._lux_per_level = lux_per_level
        self._ambient_lux = ambient_lux
        self._ambient: Ambient = ambient
        self._trigger_cable = trigger_cable
        self.nd_error_od = dict(nd_error_od or {})
        self._level = 0.0
        self._transmission = 1.0
        self._nd_od = 0.0
        self._steps: list[tuple[int, float, float, float]] = [(0, *self._light_now())]
        self._triggers: list[TriggerEdge] = []

    @property
    def level(self) -> float:
        """Level of the light source."""
        return self._level

    def lux(self) -> float:
        """Return the illuminance on the chip that the light is at or on its way to, lux."""
        if self._ambient == "capped":
            return 0.0
        return self._level * self._lux_per_level * self._transmission + self._room_lux()

    def _room_lux(self) -> float:
        """Return the light of the room on the chip, lux."""
        return self._ambient_lux if self._ambient == "open" else 0.0

    def _light_now(self) -> tuple[float, float, float]:
        """Return the illuminance on the chip (lux), the nominal OD of the filter, and the light of the room (lux)."""
        return self.lux(), self._nd_od, self._room_lux()

    def transmission(self, name: str, nd_od: float) -> float:
        """Return the true transmission of the filter `name` of nominal optical density `nd_od`."""
        return math.pow(10.0, -(nd_od + self.nd_error_od.get(name, 0.0)))

    def set_level(self, level: float) -> None:
        """Let the source step to `level` now."""
        self._level = level
        self._remember()

    def set_filter(self, name: str, nd_od: float) -> None:
        """Let the filter `name` of nominal optical density `nd_od` be in the light path from now on."""
        self._transmission = self.transmission(name, nd_od)
        self._nd_od = nd_od
        self._remember()

    def set_ambient(self, ambient: Ambient) -> None:
        """Open, shroud or cap the bench now, before a recording: the light has settled, the past is forgotten."""
        _require(ambient in _AMBIENTS, "ambient", ambient, " or ".join(_AMBIENTS))
        if ambient != self._ambient:
            self._ambient = ambient
            self._steps = [(self.clock.now_ns, *self._light_now())]

    def emit_trigger(self, *, rising: bool, at_ns: int | None = None) -> None:
        """Send an edge to the camera's trigger input, now or at a time to come; without a cable nothing arrives."""
        if self._trigger_cable:
            self._triggers.append(TriggerEdge(self.clock.now_ns if at_ns is None else at_ns, rising))

    def forget_before(self, time_ns: int) -> None:
        """Let go of what was before `time_ns`, apart from the level at that time: memory stays bounded."""
        earlier = [step for step in self._steps if step[0] < time_ns]
        self._steps = earlier[-1:] + self._steps[len(earlier) :]
        self._triggers = [edge for edge in self._triggers if edge.time_ns >= time_ns]

    def light(self, start_ns: int) -> LightHistory:
        """Return the light on the chip from `start_ns`, which becomes its t = 0, until now."""
        before = [step for step in self._steps if step[0] < start_ns][-1:]
        after = [step for step in self._steps if step[0] >= start_ns]
        steps = [(start_ns, *levels) for _, *levels in before] + after
        t_s = np.array([(time_ns - start_ns) / NS_PER_S for time_ns, *_ in steps])
        lux, nd_od, room_lux = (np.array([step[i] for step in steps]) for i in (1, 2, 3))
        return LightHistory(t_s, lux, self.rise_tau_s, nd_od, room_lux)

    def triggers(self, start_ns: int, stop_ns: int) -> list[TriggerEdge]:
        """Return the trigger edges from `start_ns` until before `stop_ns`, in order."""
        return [edge for edge in self._triggers if start_ns <= edge.time_ns < stop_ns]

    def _remember(self) -> None:
        now = self._light_now()
        if now != self._steps[-1][1:]:
            self._steps.append((self.clock.now_ns, *now))


def _require(fulfilled: bool, name: str, value: object, expected: str) -> None:
    if not fulfilled:
        raise InputError(f"optical bench: {name} is {value!r}; expected {expected}")
