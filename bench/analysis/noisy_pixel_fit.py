"""The likeliest noisy pixels, given counts and latencies, and their errors."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.noisy_pixel_model import Conditions, LatencyModel, Nodes, Pixels, goodness, log_likelihood

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.analysis.noisy_pixel_model import Answers, Latencies

    Floats = npt.NDArray[np.float64]

__all__ = ["Data", "Errors", "Found", "find_errors", "fit_jointly", "fit_pixels", "fit_tau"]

_NAMES: Final = ("theta", "noise_rms", "mismatch", "plateau", "other_ratio", "tau_ln", "delay")
_PIXELS: Final = 5  # the first of them describe pixels
_LEAST_MISMATCH: Final = 0.002  # bound, in noise rms
_NO_MISMATCH: Final = 0.04  # one below this many noise rms is taken to be at its bound
_FULL_PLATEAU: Final = 0.9995  # one above this is taken to be 1
_FITTED: Final = 4  # parameters that the counts determine
_TAU_RANGE: Final = 2.0  # of ln(tau) around where a fit starts
_DELAYS: Final = (-0.3, 3.0)  # bounds, in tau; a negative one can only be chance
_ARMED_STEP: Final = 1.2  # factor for a numerical derivative


@dataclass(frozen=True, slots=True)
class Data:
    """All that a fit is made from."""

    answers: Answers
    latencies: Latencies
    other: tuple[float, float] | None  #: threshold of the other polarity and its standard error, where it is known
    other_ratio: tuple[float, float]  #: that divided by theta, and its standard error, where it is not
    armed_ln: float  #: standard error of the logarithm of the time armed

    def loss(self, pixels: Pixels, conditions: Conditions, nodes: Nodes, scale: float = 1.0) -> float:
        """Return minus the log-likelihood of the counts, over `scale`, and of what is known of the other threshold."""
        mean, error = self.other_ratio
        if self.other is not None:
            mean, error = self.other[0] / pixels.theta, self.other[1] / pixels.theta
        known = 0.5 * ((pixels.other_ratio - mean) / error) ** 2
        return known - log_likelihood(pixels, conditions, self.answers, nodes) / scale


@dataclass(frozen=True, slots=True)
class Found:
    """Where a fit stands."""

    pixels: Pixels
    conditions: Conditions
    delay: float  #: of the light and the readout, units of tau
    poor: float  #: deviance of the latencies per degree of freedom, at least 1

    def moved(self, before: Found) -> float:
        """Return the relative change of time constant or threshold since `before`, whichever is larger."""
        tau = math.log(self.conditions.tau_s / before.conditions.tau_s)
        return max(abs(tau), abs(math.log(self.pixels.theta / before.pixels.theta)))


    def halfway(self, other: Found) -> Found:
        """Return the middle between this and `other`."""
        middle = (0.5 * (a + b) for a, b in zip(_values(self.pixels), _values(other.pixels), strict=True))
        tau_s = math.sqrt(self.conditions.tau_s * other.conditions.tau_s)
        delay = 0.5 * (self.delay + other.delay)
        return Found(Pixels(*middle), replace(self.conditions, tau_s=tau_s), delay, self.poor)


def _bounds(start: Pixels) -> list[tuple[float, float]]:
    return [
        (0.3 * start.theta, 3.0 * start.theta),
        (0.1 * start.noise_rms, 10.0 * start.noise_rms),
        (_LEAST_MISMATCH * start.noise_rms, 10.0 * start.theta),
        (0.1, 1.0),
        (0.3, 3.0),
    ]


def _first_steps(start: Pixels) -> list[float]:
    return [0.01 * start.theta, 0.02 * start.noise_rms, 0.1 * start.mismatch, 0.001, 0.03]


def _values(pixels: Pixels) -> list[float]:
    return [getattr(pixels, name) for name in _NAMES[:_PIXELS]]


def fit_pixels(data: Data, found: Found) -> Found:
    """Return about the pixels that make the counts likeliest at the time constant found so far."""
    from iminuit import Minuit

    nodes = Nodes.for_fit(found.pixels, data.answers)

    def loss(*values: float) -> float:
        return data.loss(Pixels(*values), found.conditions, nodes)

    fit = Minuit(loss, *_values(found.pixels), name=_NAMES[:_PIXELS])
    fit.errordef = Minuit.LIKELIHOOD
    fit.errors, fit.limits = _first_steps(found.pixels), _bounds(found.pixels)
    fit.strategy, fit.tol = 0, 10.0
    fit.migrad()
    return replace(found, pixels=Pixels(*(float(value) for value in fit.values)))


def fit_tau(data: Data, found: Found) -> Found | None:
    """Return the time constant and delay that fit the latencies best, for the pixels found; None without latencies."""
    from scipy.optimize import minimize

    model = LatencyModel(found.pixels, found.conditions, data.latencies)
    before_s = found.conditions.tau_s
    if not model.free(before_s):
        return None
    best = minimize(
        lambda at: model.deviance(found.pixels, before_s * math.exp(at[0]), float(at[1])),
        [0.0, found.delay],
        method="Nelder-Mead",
        bounds=[(-_TAU_RANGE, _TAU_RANGE), _DELAYS],
        options={
            "xatol": 1e-3,
            "fatol": 0.1,
            "initial_simplex": [[0.0, found.delay], [0.1, found.delay], [0.0, found.delay + 0.05]],
        },
    )
    tau_s = before_s * math.exp(best.x[0])
    poor = max(1.0, float(best.fun) / max(model.free(tau_s), 1))
    return replace(found, conditions=replace(found.conditions, tau_s=tau_s), delay=float(best.x[1]), poor=poor)


class _Joint:
    """Counts and latencies together, as a function of all that is to be found.

    Latencies that fit badly count less, by their deviance per degree of freedom.
    """

    def __init__(self, data: Data, found: Found) -> None:
        self._data, self._found = data, found
        self.nodes = Nodes.for_fit(found.pixels, data.answers)
        self.latencies = LatencyModel(found.pixels, found.conditions, data.latencies)

    def at(self, values: Floats | tuple[float, ...]) -> Found:
        """Return what the values (7,) stand for."""
        tau_s = self._found.conditions.tau_s * math.exp(values[_PIXELS])
        conditions = replace(self._found.conditions, tau_s=tau_s)
        return replace(
            self._found, pixels=Pixels(*(float(v) for v in values[:_PIXELS])), conditions=conditions, delay=values[-1]
        )

    def deviance(self, found: Found) -> float:
        """Return that of the latencies."""
        return self.latencies.deviance(found.pixels, found.conditions.tau_s, found.delay)

    def loss(self, values: Floats | tuple[float, ...], scale: float = 1.0, armed: float = 1.0) -> float:
        """Return what is made smallest; `scale` divides the counts' part, `armed` multiplies the time armed."""
        found = self.at(values)
        conditions = replace(found.conditions, armed_s=found.conditions.armed_s * armed)
        counts = self._data.loss(found.pixels, conditions, self.nodes, scale)
        return counts + 0.5 * self.deviance(found) / found.poor


def fit_jointly(data: Data, found: Found) -> Found:
    """Return what makes counts and latencies together likeliest, the latencies' law taken as linear around `found`."""
    from iminuit import Minuit

    joint = _Joint(data, found)
    fit = Minuit(lambda *values: joint.loss(values), *_values(found.pixels), 0.0, found.delay, name=_NAMES)
    fit.errordef = Minuit.LIKELIHOOD
    fit.errors = [*_first_steps(found.pixels), 0.01, 0.01]
    fit.limits = [*_bounds(found.pixels), (-_TAU_RANGE, _TAU_RANGE), _DELAYS]
    fit.strategy = 0
    fit.migrad()
    best = joint.at([float(value) for value in fit.values])
    return replace(best, poor=max(1.0, joint.deviance(best) / max(joint.latencies.free(best.conditions.tau_s), 1)))


@dataclass(frozen=True, slots=True)
class Errors:
    """Standard errors, and how well the counts are described."""

    theta: float
    noise_rms: float
    mismatch: float  #: 0 where the mismatch is at its bound
    plateau: float  #: 0 where the plateau is 1
    tau_ln: float
    chi2: float
    dof: int


def find_errors(data: Data, found: Found) -> Errors | None:
    """Return the errors of a fit; None where the data leave something open.

    They come from the curvature of the loss, in which counts that fit badly count less, by their chi-square per
    degree of freedom, and from the shift of the minimum with the time armed where that is not known.
    """
    joint = _Joint(data, found)
    chi2, judged = goodness(found.pixels, found.conditions, data.answers, joint.nodes)
    dof = max(judged - _FITTED, 1)
    curvature = _Curvature(joint, found, max(1.0, chi2 / dof))
    covariance = curvature.covariance()
    if covariance is None:
        return None
    if data.armed_ln > 0.0:
        shift = curvature.shift(covariance) / math.log(_ARMED_STEP)
        covariance = covariance + np.outer(shift, shift) * data.armed_ln**2
    theta, noise, mismatch, plateau, _, tau, _ = (float(v) for v in np.sqrt(np.diag(covariance)) * curvature.free)
    return Errors(theta, noise, mismatch, plateau, tau, chi2, dof)


class _Curvature:
    """Derivatives of the loss around its minimum."""

    def __init__(self, joint: _Joint, found: Found, scale: float) -> None:
        self._joint, self._scale = joint, scale
        pixels, noise = found.pixels, found.pixels.noise_rms
        self._at = np.array([*_values(pixels), 0.0, found.delay])
        self._step = np.array([0.02 * noise, 0.01 * noise, 0.02 * noise, 3e-4, 0.02, 0.005, 0.005])
        self.free = np.ones(self._at.size, np.bool_)
        self.free[2] = pixels.mismatch > _NO_MISMATCH * noise
        self.free[3] = pixels.plateau < _FULL_PLATEAU

    def _gradient(self, at: Floats, armed: float = 1.0) -> Floats:
        gradient = np.zeros(at.size)
        for i in np.flatnonzero(self.free):
            step = np.where(np.arange(at.size) == i, self._step, 0.0)
            up, down = (self._joint.loss(at + s * step, self._scale, armed) for s in (1.0, -1.0))
            gradient[i] = (up - down) / (2.0 * self._step[i])
        return gradient

    def covariance(self) -> Floats | None:
        """Return (7, 7) the inverse of the curvature, zero for what is at its bound; None where there is none."""
        size = self._at.size
        hessian = np.zeros((size, size))
        for i in np.flatnonzero(self.free):
            step = np.where(np.arange(size) == i, self._step, 0.0)
            hessian[i] = (self._gradient(self._at + step) - self._gradient(self._at - step)) / (2.0 * self._step[i])
        free = np.ix_(self.free, self.free)
        scale = np.outer(self._step, self._step)[free]
        curvature = 0.5 * (hessian + hessian.T)[free] * scale
        if not np.isfinite(curvature).all() or np.linalg.eigvalsh(curvature).min() <= 0.0:
            return None
        covariance = np.zeros((size, size))
        covariance[free] = np.linalg.inv(curvature) * scale
        return covariance

    def shift(self, covariance: Floats) -> Floats:
        """Return (7,) how far the minimum moves when the time armed is longer by the step."""
        return np.asarray(covariance @ (self._gradient(self._at) - self._gradient(self._at, _ARMED_STEP)))
