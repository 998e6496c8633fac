"""The light on the chip: what was commanded, and what source, filter and surroundings make of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from protocols.errors import InputError
from sim_backend.pixel.hooks import called, refused
from sim_backend.pixel.light import LightHistory, LightSampler
from sim_backend.pixel.philox import uniforms

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel.chain import Chain
    from sim_backend.pixel.hooks import Hook

__all__ = ["ChipLight", "commanded_light", "flicker_phase", "settled_ripple"]

_PURPOSE_FLICKER = 16  # of the random number that is the phase of the flicker; engines use lower ones


class ChipLight:
    """The illuminance on the chip at the times ``n dt``, with everything that the chain does to it.

    That of t = 0 is what pixels have settled to. In this order: commanded level with the error of its contrast, rise
    time, drift, flicker, error of the ND filter; then light of the room and stray light, which none of these changes;
    then the functions of effects.

    Parameters
    ----------
    chain
        Of the pixels; its light part is used.
    light
        The commanded levels.
    dt_s
        Length of a sample, s.
    seed
        Of the recording; draws the phase of the flicker, where the chain leaves it open.

    Raises
    ------
    InputError
        Both light and chain have a rise time.
    """

    def __init__(self, chain: Chain, light: LightHistory, dt_s: float, seed: int) -> None:
        self._chain = chain
        self._dt_s = dt_s
        commanded = commanded_light(chain, light)
        self._sampler = LightSampler(commanded, dt_s)
        self.rise_tau_s = commanded.rise_tau_s  #: time constant of the source's edges, s
        self._room_lux = np.asarray(light.room_lux)
        self._nd_factor = np.where(np.asarray(light.nd_od) > 0.0, math.pow(10.0, -chain.nd_error_od), 1.0)
        self._phase = flicker_phase(chain, seed)
        self._ripple_at_start = settled_ripple(chain, seed)

    def lux(self, start: int, stop: int) -> npt.NDArray[np.float64]:
        """Return the illuminance at the samples `start` to `stop` - 1, lux."""
        return self.lux_at(np.arange(start, stop))

    def lux_at(self, n: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
        """Return the illuminance at some samples, in order, lux."""
        lux: npt.NDArray[np.float64] = self._sampler.lux_at(n)
        factor = self._factor(n)
        if factor is not None:
            room = self._room_lux[self._sampler.segments(n)]
            lux = np.asarray(np.where(lux > room, lux - room, 0.0) * factor + room)
        lux = np.asarray(lux + self._chain.stray_lux)
        for hook in self._chain.hooks.light:
            lux = _lux_by(hook, lux, np.asarray(n * self._dt_s, np.float64))
        return lux

    @property
    def first(self) -> npt.NDArray[np.int64]:
        """First sample of each commanded level, (m,)."""
        return self._sampler.first

    @property
    def settled_lux(self) -> npt.NDArray[np.float64]:
        """Illuminance of each commanded level long after its edge, without drift and flicker, (m,) lux."""
        return self._behind_filter(self._sampler.settled_lux)

    @property
    def at_edge_lux(self) -> npt.NDArray[np.float64]:
        """Illuminance right at the edge to each commanded level, behind its filter; no drift or flicker, (m,) lux."""
        return self._behind_filter(self._sampler.at_edge_lux)

    @property
    def never_settles(self) -> bool:
        """Whether the light drifts or flickers."""
        return not self._chain.drift_per_s == self._chain.flicker_depth == 0.0

    def _behind_filter(self, lux: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        room = self._room_lux
        return np.asarray(np.where(lux > room, lux - room, 0.0) * self._nd_factor + room + self._chain.stray_lux)

    def _factor(self, n: npt.NDArray[np.int64]) -> npt.NDArray[np.float64] | None:
        """Return what source and filter make of the source's light; None: they leave it as it is."""
        chain = self._chain
        if not _has_factor(chain):
            return None
        t_s = n * self._dt_s
        factor: npt.NDArray[np.float64] = self._nd_factor[self._sampler.segments(n)]
        if chain.flicker_depth != 0.0:
            turns = np.remainder(chain.flicker_hz * t_s, 1.0)
            ripple = np.where(n == 0, self._ripple_at_start, np.sin(2.0 * math.pi * turns + self._phase))
            factor = (1.0 + chain.flicker_depth * ripple) * factor
        if chain.drift_per_s != 0.0:
            factor = np.maximum(1.0 + chain.drift_per_s * t_s, 0.0) * factor
        return factor


def _has_factor(chain: Chain) -> bool:
    return not chain.drift_per_s == chain.flicker_depth == chain.nd_error_od == 0.0


def _lux_by(hook: Hook, lux: npt.NDArray[np.float64], t_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return what the light hook of an effect makes of the light."""
    made = np.asarray(called(hook, lux.copy(), t_s))
    if made.shape != lux.shape or made.dtype.kind not in "fiu":
        raise refused(hook, f"an array of {made.dtype}, shape {made.shape}", f"numbers of lux, shape {lux.shape}")
    bad = ~((made >= 0.0) & (made < np.inf))
    if np.any(bad):
        raise refused(hook, f"{made[bad][0]:g} lux at {t_s[bad][0]:g} s", "0 lux or more")
    return made.astype(np.float64)


def flicker_phase(chain: Chain, seed: int) -> float:
    """Return the phase of the flicker in a recording, rad; where the chain leaves it open, it is drawn."""
    if chain.flicker_depth == 0.0:
        return 0.0
    if chain.flicker_phase is not None:
        return chain.flicker_phase
    return 2.0 * math.pi * float(uniforms(seed, np.zeros(1, np.uint32), _PURPOSE_FLICKER)[0])


def settled_ripple(chain: Chain, seed: int) -> float:
    """Return the ripple to which pixels have settled at t = 0, for a depth of 1: that behind a low-pass."""
    lag = math.atan(chain.flicker_hz / chain.flicker_settled_hz)
    return math.cos(lag) * math.sin(flicker_phase(chain, seed) - lag)


def commanded_light(chain: Chain, light: LightHistory) -> LightHistory:
    """Return the commanded levels with the error of their contrast, and the rise time of the source.

    Raises
    ------
    InputError
        Both light and chain have a rise time.
    """
    if chain.rise_tau_s > 0.0 and light.rise_tau_s > 0.0:
        raise InputError(
            f"light: the source's rise time ({light.rise_tau_s:g} s) and the model's ({chain.rise_tau_s:g} s) are "
            "both given; expected one"
        )
    if chain.contrast_gain == 1.0 and chain.rise_tau_s == 0.0:
        return light
    rise_tau_s = max(chain.rise_tau_s, light.rise_tau_s)
    return LightHistory(light.t_s, _with_contrast(chain, light), rise_tau_s, light.nd_od, light.room_lux)


def _with_contrast(chain: Chain, light: LightHistory) -> npt.NDArray[np.float64]:
    """Return the levels; those of the source with the true contrast to the first that is lit."""
    source = light.lux - light.room_lux
    first = int(np.searchsorted(light.t_s, 0.0, side="right")) - 1  # of several levels at t = 0 the last counts
    lit = source > 0.0
    if chain.contrast_gain == 1.0 or not np.any(lit[first:]):
        return light.lux
    baseline = source[first:][lit[first:]][0]
    return np.where(lit, baseline * (source / baseline) ** chain.contrast_gain, 0.0) + light.room_lux
