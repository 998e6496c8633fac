"""The light on the chip: what was commanded, and what source, filter and surroundings make of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from protocols.errors import InputError
from sim_backend.pixel.light import LightHistory, LightSampler
from sim_backend.pixel.philox import uniforms

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel.chain import Chain

__all__ = ["ChipLight"]

_PURPOSE_FLICKER = 16  # of the random number that is the phase of the flicker; engines use lower ones


class ChipLight:
    """The illuminance on the chip at the times ``n dt``, with everything that the chain does to it.

    In this order: commanded level with the error of its contrast, rise time, drift, flicker, error of the ND filter,
    stray light.

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
        self._sampler = LightSampler(_commanded(chain, light), dt_s)
        self._nd_factor = np.where(np.asarray(light.nd_od) > 0.0, math.pow(10.0, -chain.nd_error_od), 1.0)
        drawn = 2.0 * math.pi * float(uniforms(seed, np.zeros(1, np.uint32), _PURPOSE_FLICKER)[0])
        self._phase = drawn if chain.flicker_phase is None else chain.flicker_phase

    def lux(self, start: int, stop: int) -> npt.NDArray[np.float64]:
        """Return the illuminance at the samples `start` to `stop` - 1, lux."""
        chain = self._chain
        lux = self._sampler.lux(start, stop)
        t_s = np.arange(start, stop) * self._dt_s
        if chain.drift_per_s != 0.0:
            lux = lux * np.maximum(1.0 + chain.drift_per_s * t_s, 0.0)
        if chain.flicker_depth != 0.0:
            turns = np.remainder(chain.flicker_hz * t_s, 1.0)
            lux = lux * (1.0 + chain.flicker_depth * np.sin(2.0 * math.pi * turns + self._phase))
        if chain.nd_error_od != 0.0:
            lux = lux * self._nd_factor[self._sampler.segments(start, stop)]
        return lux + chain.stray_lux


def _commanded(chain: Chain, light: LightHistory) -> LightHistory:
    """Return the commanded levels with the error of their contrast, and the rise time of the source."""
    if chain.rise_tau_s > 0.0 and light.rise_tau_s > 0.0:
        raise InputError(
            f"light: the source's rise time ({light.rise_tau_s:g} s) and the model's ({chain.rise_tau_s:g} s) are "
            "both given; expected one"
        )
    lux = light.lux
    lit = lux > 0.0
    if chain.contrast_gain != 1.0 and np.any(lit):
        baseline = lux[lit][0]
        lux = np.where(lit, baseline * (lux / baseline) ** chain.contrast_gain, 0.0)
    return LightHistory(light.t_s, lux, max(chain.rise_tau_s, light.rise_tau_s), light.nd_od)
