"""A simulated wheel of ND filters."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from drivers.interfaces import Filter, FilterWheel
from protocols.errors import InputError
from sim_backend.devices.identity import simulated_identity

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sim_backend.world import OpticalBench

__all__ = ["SimulatedFilterWheel"]


class SimulatedFilterWheel(FilterWheel):
    """A wheel with named ND filters; a move takes the same time between any two of them.

    The light changes when the filter has arrived. What a filter really transmits is the world's affair. A filter that
    is in stays in when the wheel is closed: it has no state that is safer than another.

    Parameters
    ----------
    world
        The world in whose light path the wheel stands.
    filters
        Nominal optical density of each position, by name; the first is in when the wheel connects.
    move_s
        Time that a move takes, s.
    name
        What the operator calls it.
    """

    def __init__(
        self, world: OpticalBench, *, filters: Mapping[str, float], move_s: float = 1.0, name: str = "filter wheel"
    ) -> None:
        super().__init__(name)
        if not filters:
            raise InputError(f"{name}: has no filters; expected one or more")
        for position, nd_od in filters.items():
            if not 0.0 <= nd_od < math.inf:
                raise InputError(f"{name}: filter {position} has optical density {nd_od}; expected 0 or more")
        if not 0.0 <= move_s < math.inf:
            raise InputError(f"{name}: move_s is {move_s}; expected 0 s or more")
        unknown = [position for position in world.nd_error_od if position not in filters]
        if unknown:
            raise InputError(f"{name}: the world knows an error of {', '.join(unknown)}; it has {', '.join(filters)}")
        self._world = world
        self._move_s = move_s
        self.filters = tuple(Filter(position, float(nd_od)) for position, nd_od in filters.items())
        self._selected = self.filters[0]

    def identity(self) -> dict[str, str]:
        """Return maker, model, serial number and firmware version."""
        self.require_connected("identify itself")
        return simulated_identity(f"simulated filter wheel, {len(self.filters)} positions", "simulated")

    def selected(self) -> str:
        """Return the name of the filter that is in."""
        self.require_connected("read the position")
        return self._selected.name

    def _connect(self) -> None:
        self._world.set_filter(self._selected.name, self._selected.nd_od)

    def _close(self) -> None:
        """There is nothing to let go of."""

    def _safe_state(self) -> None:
        """No position is safer than another."""

    def _select(self, name: str) -> None:
        wanted = next(f for f in self.filters if f.name == name)
        if wanted != self._selected:
            self._world.clock.sleep(self._move_s)
            self._selected = wanted
            self._world.set_filter(wanted.name, wanted.nd_od)
