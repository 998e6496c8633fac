"""The light on the chip over time, and its value at the samples of an engine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["LightHistory", "LightSampler", "first_sample_at"]

#: An edge this close to a sample, in samples, counts as being at it: 0.3 s is not a whole number of 10 us in binary.
_TIE_SAMPLES: Final = 1e-6
#: The light counts as settled when it is this close to the commanded level, relatively or in lux.
_SETTLED_RELATIVE: Final = 1e-12
_SETTLED_LUX: Final = 1e-15


@dataclass(frozen=True, slots=True)
class LightHistory:
    """Illuminance on the chip as commanded, with the nominal ND filter in: a step function from t = 0.

    With a rise time the light follows as ``dE/dt = (E_commanded - E) / rise_tau_s``; at t = 0 it is settled.
    `nd_od` says which filter is in the light path, `room_lux` how much of the light does not come from the source;
    both are in the levels already.
    """

    t_s: npt.NDArray[np.float64]  #: (m,) s; time of each edge, ascending, the first is 0
    lux: npt.NDArray[np.float64]  #: (m,) lux from that edge to the next
    rise_tau_s: float = 0.0  #: time constant of the light's edges, s
    nd_od: npt.NDArray[np.float64] | float = 0.0  #: (m,) or one for all; nominal OD of the filter that is in, 0: none
    room_lux: npt.NDArray[np.float64] | float = 0.0  #: (m,) or one for all; light of the room on the chip, lux

    def __post_init__(self) -> None:
        t_s = np.asarray(self.t_s, np.float64)
        lux = np.asarray(self.lux, np.float64)
        if t_s.ndim != 1 or t_s.shape != lux.shape or len(t_s) == 0:
            raise ValueError(f"light history: times {t_s.shape}, levels {lux.shape}; expected as many, one or more")
        if t_s[0] != 0.0 or not np.all(np.diff(t_s) >= 0.0):
            raise ValueError("light history: times must ascend from 0 s")
        if not np.all(np.isfinite(lux)) or lux.min() < 0.0:
            raise ValueError("light history: each level must be a number of lux, 0 or more")
        if not 0.0 <= self.rise_tau_s < np.inf:
            raise ValueError(f"light history: the rise time is {self.rise_tau_s} s; expected 0 or more")
        object.__setattr__(self, "nd_od", _for_each_level("optical density", self.nd_od, lux, np.inf))
        object.__setattr__(self, "room_lux", _for_each_level("light of the room", self.room_lux, lux, lux))
        object.__setattr__(self, "t_s", t_s)
        object.__setattr__(self, "lux", lux)

    @classmethod
    def constant(cls, lux: float, nd_od: float = 0.0) -> LightHistory:
        """Return a light that never changes."""
        return cls(np.zeros(1), np.array([lux]), nd_od=nd_od)


def _for_each_level(
    name: str,
    values: npt.NDArray[np.float64] | float,
    lux: npt.NDArray[np.float64],
    most: npt.NDArray[np.float64] | float,
) -> npt.NDArray[np.float64]:
    """Return one value for each level, from 0 to `most`."""
    values = np.asarray(values, np.float64)
    if values.shape not in ((), lux.shape) or not np.all((values >= 0.0) & (values <= most) & np.isfinite(values)):
        raise ValueError(f"light history: {name}: expected 0 or more, one for each level or one for all")
    return np.broadcast_to(values, lux.shape)


def first_sample_at(t_s: npt.NDArray[np.float64], dt_s: float) -> npt.NDArray[np.int64]:
    """Return the index of the first sample at or after each time."""
    return np.ceil(t_s / dt_s - _TIE_SAMPLES).astype(np.int64)


class LightSampler:
    """The illuminance at the times ``n * dt_s``, exact for the first-order rise.

    Parameters
    ----------
    light
        The commanded levels.
    dt_s
        Length of a sample, s.
    """

    def __init__(self, light: LightHistory, dt_s: float) -> None:
        self._light = light
        self._dt_s = dt_s
        self.first = first_sample_at(light.t_s, dt_s)  #: (m,) first sample of each level
        self.at_edge_lux = _levels_at_edges(light)  #: (m,) illuminance at the moment of each edge, lux
        self.settled_lux = light.lux  #: (m,) illuminance long after it, lux

    def segments(self, n: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Return the number of the commanded level at some samples."""
        return np.searchsorted(self.first, n, side="right") - 1

    def lux(self, start: int, stop: int) -> npt.NDArray[np.float64]:
        """Return the illuminance at the samples `start` to `stop` - 1, lux."""
        return self.lux_at(np.arange(start, stop))

    def lux_at(self, n: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
        """Return the illuminance at some samples, lux."""
        segment = self.segments(n)
        commanded = self._light.lux[segment]
        if self._light.rise_tau_s == 0.0:
            return commanded
        since_s = np.maximum(n * self._dt_s - self._light.t_s[segment], 0.0)
        gap = (self.at_edge_lux[segment] - commanded) * np.exp(-since_s / self._light.rise_tau_s)
        settled = np.abs(gap) <= _SETTLED_RELATIVE * commanded + _SETTLED_LUX
        return np.where(settled, commanded, commanded + gap)


def _levels_at_edges(light: LightHistory) -> npt.NDArray[np.float64]:
    """Return the illuminance at the moment of each edge, lux."""
    at_edge = np.empty(len(light.lux))
    at_edge[0] = light.lux[0]
    if light.rise_tau_s > 0.0:
        remains = np.exp(-np.diff(light.t_s) / light.rise_tau_s)
        for i, factor in enumerate(remains):
            at_edge[i + 1] = light.lux[i] + (at_edge[i] - light.lux[i]) * factor
    return at_edge
