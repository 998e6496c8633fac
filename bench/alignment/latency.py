"""When the light changed, told by when the first pixels answered.

A latency that all edges share cannot be told from a shift of the clock. Those that depend on the edge can in part:
the first answers to small steps come later than those to large ones, and to darkening later than to brightening.
With what is known beforehand of light and pixels that narrows the latency; what is left is said as a bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

__all__ = ["Answered", "Answering", "Began", "light_began"]

_GRID_S: Final = 1e-5
_LONGEST_S: Final = 0.02
#: The pixels that answer first have a low threshold, or noise close to it: this part of the mean.
_FIRST_PIXELS: Final = 0.75
_UNCERTAIN: Final = 0.3  #: standard deviation of ln of thresholds and of a bandwidth that are given
_WITHIN: Final = np.linspace(-2.0, 2.0, 9)  #: standard deviations at which they are tried
_RISES_S: Final = (0.0, 1e-4, 3e-4, 6e-4, 1e-3)  #: of a light whose rise time is not given
_BANDWIDTHS_HZ: Final = np.geomspace(100.0, 10e3, 9)  #: of pixels whose bandwidth is not given
_ELECTRONICS_S: Final = 5e-5  #: comparator and read-out, after the signal has crossed the threshold...
_ELECTRONICS_SD_S: Final = 3e-5  #: ...between 0 and 0.1 ms
#: Pixels that the edge before did not reset are closer to the threshold, and answer sooner than thresholds and
#: low-pass say. This part of a latency is not known...
_MODEL_PART: Final = 0.6
_MODEL_S: Final = 3e-5  #: ...and this much of any
_NOT_DUE: Final = 8.0  #: ln of the odds against answers to a step that should not be answered
_UNCLEAR_S: Final = 3e-4  #: fronts that are known no better, and
_LATE_S: Final = 5e-3  #: that come so far from the clearest one, are answers to something else
_FREEDOM: Final = 4.0  #: degrees of freedom of Student's distribution, for kinds that do not agree
_TURNS: Final = 5
_BOUND_SD: Final = 2.0
_MOST_KINDS: Final = 16  #: that are used, the largest steps


@dataclass(frozen=True, slots=True)
class Answering:
    """What is known beforehand of light and pixels, for the latency that no time axis made of events can tell."""

    rise_tau_s: float | None = None  #: time constant of the light's edges, s; None: unknown, up to 1 ms
    bandwidth_hz: float | None = None  #: of the pixels at the light of the edges; None: unknown, 100 Hz or more
    theta_on: float = 0.3  #: mean threshold for brightening, ln
    theta_off: float = 0.3  #: mean threshold for darkening, ln

    def __post_init__(self) -> None:
        if self.rise_tau_s is not None and not 0.0 <= self.rise_tau_s < np.inf:
            raise InputError(f"answering: rise_tau_s: {self.rise_tau_s}; expected 0 s or more")
        more = {"bandwidth_hz": self.bandwidth_hz, "theta_on": self.theta_on, "theta_off": self.theta_off}
        for name, value in more.items():
            if value is not None and not 0.0 < value < np.inf:
                raise InputError(f"answering: {name}: {value}; expected more than 0")


@dataclass(frozen=True, slots=True)
class Answered:
    """The first answers to edges of one kind."""

    up: bool  #: the light gets brighter
    contrast: float  #: size of the step, ln
    t_s: float  #: when the rate of events begins to rise
    sd_s: float


@dataclass(frozen=True, slots=True)
class Began:
    """When the light changed, on the same axis as the answers."""

    t_s: float
    sd_s: float  #: by the scatter of the events alone
    bound_s: float  #: how far off it may be beside that


def light_began(answered: Sequence[Answered], answering: Answering) -> Began:
    """Return when the light changed; at least one kind must have been answered.

    All thresholds, bandwidths and rise times that may be are tried; each has a place for the edges, and a probability
    by how well all kinds agree on it.
    """
    kinds = _clear(answered)
    latency = np.stack([_latencies(kind, answering) for kind in kinds])  # (k, on, off, pole, rise)
    latency = latency.reshape(len(kinds), -1)
    prior = _prior(answering).reshape(-1)
    due = np.isfinite(latency)
    latency = np.where(due, latency, 0.0)
    own_sd = np.array([kind.sd_s for kind in kinds])[:, None]
    believed = due / (own_sd**2 + (_MODEL_PART * latency) ** 2 + _MODEL_S**2)
    place = np.array([kind.t_s for kind in kinds])[:, None] - latency
    usable = believed.sum(axis=0) > 0.0
    if not usable.any():
        first = min(kinds, key=lambda kind: kind.t_s)
        return Began(first.t_s - 0.5e-3, first.sd_s, 1e-3)
    mean, weight = _robust_mean(place, believed)
    total = np.where(usable, weight.sum(axis=0), 1.0)
    apart = believed * np.square(place - mean) / _FREEDOM
    likeness = prior - 0.5 * (_FREEDOM + 1.0) * np.log1p(apart).sum(axis=0) - _NOT_DUE * (~due).sum(axis=0)
    likeness += 0.5 * np.log(np.where(due, believed, 1.0)).sum(axis=0) - 0.5 * np.log(total)
    likeness[~usable] = -np.inf
    chance = np.exp(likeness - likeness.max())
    chance /= chance.sum()
    at_s = float((chance * mean).sum())
    variance = float((chance * (np.square(mean - at_s) + 1.0 / total)).sum())
    sd_s = float(np.sqrt((chance * ((weight / total) ** 2 * own_sd**2).sum(axis=0)).sum()))
    return Began(at_s - _ELECTRONICS_S, sd_s, _BOUND_SD * float(np.sqrt(variance + _ELECTRONICS_SD_S**2)))


def _robust_mean(place: Floats, believed: Floats) -> tuple[Floats, Floats]:
    """Return the mean place of all kinds and the weight of each, for deviations of Student's distribution.

    A kind whose front was mistaken, for a background event before it for instance, has little say.
    """
    weight = believed
    for _ in range(_TURNS):
        mean = (weight * place).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-300)
        weight = believed * (_FREEDOM + 1.0) / (_FREEDOM + believed * np.square(place - mean))
    return np.asarray(mean, np.float64), np.asarray(weight, np.float64)


def _clear(answered: Sequence[Answered]) -> list[Answered]:
    """Return the kinds that were clearly answered, the largest steps; of what is all unclear the best."""
    clearest = min(answered, key=lambda kind: kind.sd_s)
    near = [kind for kind in answered if kind.sd_s <= _UNCLEAR_S and abs(kind.t_s - clearest.t_s) < _LATE_S]
    return sorted(near or [clearest], key=lambda kind: -kind.contrast)[:_MOST_KINDS]


def _prior(answering: Answering) -> Floats:
    """Return ln of what is believed beforehand of each choice: (on, off, pole, rise)."""
    theta = -0.5 * _WITHIN**2
    pole = np.zeros(len(_BANDWIDTHS_HZ)) if answering.bandwidth_hz is None else theta
    rises = np.zeros(len(_RISES_S) if answering.rise_tau_s is None else 1)
    return np.asarray(theta[:, None, None, None] + theta[:, None, None] + pole[:, None] + rises, np.float64)


def _latencies(kind: Answered, answering: Answering) -> Floats:
    """Return the latency of the first answers for each choice: (on, off, pole, rise); one threshold counts."""
    spread = np.exp(_UNCERTAIN * _WITHIN)
    thetas = _FIRST_PIXELS * (answering.theta_on if kind.up else answering.theta_off) * spread
    rises = _RISES_S if answering.rise_tau_s is None else (answering.rise_tau_s,)
    bandwidths = _BANDWIDTHS_HZ if answering.bandwidth_hz is None else answering.bandwidth_hz * spread
    step = kind.contrast if kind.up else -kind.contrast
    table = np.array([[_crossings(step, thetas, rise, float(f)) for rise in rises] for f in bandwidths])
    table = np.moveaxis(table, 2, 0)  # (theta, pole, rise)
    shape = (len(thetas), len(thetas), *table.shape[1:])
    return np.broadcast_to(table[:, None] if kind.up else table[None], shape)


def _crossings(step: float, thetas: Floats, rise_tau_s: float, bandwidth_hz: float) -> Floats:
    """Return when the signal of a pixel crosses thresholds after an edge, s; infinite where it does not.

    The logarithm of the light, which goes over as ``exp(-t / rise_tau_s)``, passes a low-pass.
    """
    from scipy.signal import lfilter

    t = np.arange(0.0, _LONGEST_S, _GRID_S)
    light = np.full(len(t), step)
    if rise_tau_s > 0.0:
        light = np.log1p(np.expm1(step) * -np.expm1(-t / rise_tau_s))
    kept = float(np.exp(-2.0 * np.pi * bandwidth_hz * _GRID_S))
    # Both go one way, so that the signal is looked up by its size.
    size = np.abs(lfilter([1.0 - kept], [1.0, -kept], light))
    return np.interp(thetas, np.concatenate(([0.0], size)), np.concatenate(([0.0], t)), right=np.inf)
