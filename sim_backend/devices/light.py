"""A simulated light source, timed by itself or by the host."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from drivers.interfaces import LightSource, Limits, PlayedWaveform
from protocols.errors import InputError
from sim_backend.clock import NS_PER_S, to_ns
from sim_backend.devices.identity import simulated_identity

if TYPE_CHECKING:
    from drivers.interfaces import Waveform
    from sim_backend.world import OpticalBench

__all__ = ["SimulatedLightSource"]

#: 10 % to 90 % of a first-order step, in time constants.
_EDGE_TAUS: Final = math.log(9.0)


class SimulatedLightSource(LightSource):
    """A source whose level steps with a first-order rise, and which sends a trigger edge at every commanded edge.

    Timed by the device, each edge comes at its time. Timed by the host, each level is a request of its own: the light
    steps `latency_s` after it was written, it is acknowledged when the light has settled, and the next one is not
    written before; a waveform that is too fast for that comes late, and the times that are returned say so.

    The level with which a waveform begins is no edge: it has no trigger.

    Parameters
    ----------
    world
        The world that is lit.
    lowest, highest
        Limits of the level; 0 (dark) is always allowed.
    unit
        Of the level.
    timing
        Who times a waveform: "device" or "host".
    rise_tau_s
        Time constant of an edge, s.
    settling_s
        From a step until the light is stable, s.
    latency_s
        From writing a request until the light steps, s; only where the host times.
    level_step
        Between two levels that it can be set to; 0: any level.
    name
        What the operator calls it.
    """

    def __init__(
        self,
        world: OpticalBench,
        *,
        lowest: float,
        highest: float,
        unit: str,
        timing: Literal["host", "device"] = "device",
        rise_tau_s: float = 0.0,
        settling_s: float = 0.0,
        latency_s: float = 0.0,
        level_step: float = 0.0,
        name: str = "light source",
    ) -> None:
        super().__init__(name)
        if timing not in ("host", "device"):
            raise InputError(f"{name}: timing is {timing!r}; expected host or device")
        if not 0.0 < lowest < highest < math.inf:
            raise InputError(f"{name}: limits are {lowest} to {highest} {unit}; expected 0 < lowest < highest")
        durations = {"rise_tau_s": rise_tau_s, "settling_s": settling_s, "latency_s": latency_s}
        for what, value in durations.items():
            if not 0.0 <= value < math.inf:
                raise InputError(f"{name}: {what} is {value}; expected 0 s or more")
        self._world = world
        self._rise_tau_s = rise_tau_s
        self._latency_s = latency_s if timing == "host" else 0.0
        if not 0.0 <= level_step < highest:
            raise InputError(
                f"{name}: level_step is {level_step}; expected 0 {unit} or more, and less than {highest}"
            )
        self.level_step = level_step
        self.timing = timing
        self.limits = Limits(lowest, highest, unit)
        self.edge_time_s = _EDGE_TAUS * rise_tau_s
        self.settling_s = settling_s

    def identity(self) -> dict[str, str]:
        """Return maker, model, serial number and firmware version."""
        self.require_connected("identify itself")
        return simulated_identity(f"simulated light source, timed by the {self.timing}", "simulated")

    def level(self) -> float:
        """Return the level that the source is at."""
        self.require_connected("read the level")
        return self._world.level

    def _connect(self) -> None:
        self._world.rise_tau_s = self._rise_tau_s

    def _close(self) -> None:
        """There is nothing to let go of."""

    def _safe_state(self) -> None:
        self._world.set_level(0.0)

    def _set_level(self, level: float) -> None:
        self._world.clock.sleep(self._latency_s)
        self._world.set_level(level)

    def _play(self, waveform: Waveform) -> PlayedWaveform:
        if len(waveform.t_s) == 0 or waveform.t_s[0] != 0.0 or np.any(np.diff(waveform.t_s) < 0.0):
            raise ValueError(f"{self.name}: the times of a waveform must ascend from 0 s")
        if waveform.duration_s < waveform.t_s[-1]:
            raise ValueError(f"{self.name}: a waveform of {waveform.duration_s} s has an edge after its end")
        return self._play_by_device(waveform) if self.timing == "device" else self._play_by_host(waveform)

    def _play_by_device(self, waveform: Waveform) -> PlayedWaveform:
        clock = self._world.clock
        begin_ns = clock.now_ns
        for i, t_s in enumerate(waveform.t_s):
            clock.advance_to(begin_ns + to_ns(float(t_s)))
            self._edge(float(waveform.level[i]), first=i == 0)
        clock.advance_to(begin_ns + to_ns(waveform.duration_s))
        return PlayedWaveform(waveform.t_s.copy())

    def _play_by_host(self, waveform: Waveform) -> PlayedWaveform:
        clock = self._world.clock
        begin_ns = clock.now_ns
        times_ns = np.empty((3, len(waveform.t_s)), np.int64)  # written, edge, settled (and acknowledged)
        for i, t_s in enumerate(waveform.t_s):
            clock.advance_to(max(clock.now_ns, begin_ns + to_ns(float(t_s))))
            if i == 0 and waveform.level[0] == self._world.level:
                times_ns[:, 0] = clock.now_ns  # the light is there already: nothing to ask for
                continue
            times_ns[0, i] = clock.now_ns
            clock.sleep(self._latency_s)
            times_ns[1, i] = clock.now_ns
            self._edge(float(waveform.level[i]), first=i == 0)
            clock.sleep(self.settling_s)
            times_ns[2, i] = clock.now_ns
        clock.advance_to(max(clock.now_ns, begin_ns + to_ns(waveform.duration_s)))
        written, edge, settled = (times_ns - begin_ns) / NS_PER_S
        return PlayedWaveform(edge, t_written_s=written, t_acknowledged_s=settled, t_settled_s=settled.copy())

    def _edge(self, level: float, *, first: bool) -> None:
        """Step to `level` now; tell the camera, unless it is the level with which the waveform begins."""
        rising = level >= self._world.level
        self._world.set_level(level)
        if not first:
            self._world.emit_trigger(rising=rising)
