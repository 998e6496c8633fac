"""The likeliest noisy pixels for a time constant, the likeliest time constant for pixels, and the errors of both."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.noisy_pixel_model import Conditions, LatencyModel, Nodes, Pixels, goodness, log_likelihood

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from bench.analysis.noisy_pixel_model import Answers, Latencies

    Floats = npt.NDArray[np.float64]

__all__ = ["Data", "Errors", "TauFit", "find_errors", "fit_pixels", "fit_tau"]

_NAMES: Final = ("theta", "noise_rms", "mismatch", "plateau", "other_ratio")
_LATENCY_NAMES: Final = ("theta", "noise_rms", "other_ratio")  # those of them that latencies depend on
_LEAST_MISMATCH: Final = 0.002  # bound, in noise rms
_NO_MISMATCH: Final = 0.04  # one below this many noise rms is taken to be at its bound
_FULL_PLATEAU: Final = 0.9995  # one above this is taken to be 1
_FITTED: Final = 4  # parameters that the counts determine
_TAU_RANGE: Final = 2.0  # of ln(tau) around where a fit starts
_DELAYS: Final = (-0.3, 3.0)  # bounds, in tau; a negative one can only be chance
_SMALL: Final = 0.05  # step of the derivatives by which latencies move; threshold and noise in noise rms
_TAU_STEP: Final = 1.02  # factors for numerical derivatives
_ARMED_STEP: Final = 1.2


@dataclass(frozen=True, slots=True)
class Data:
    """All that a fit is made from."""

    answers: Answers
    latencies: Latencies
    other: tuple[float, float] | None  #: threshold of the other polarity and its standard error, where it is known
    other_ratio: tuple[float, float]  #: that divided by theta, and its standard error, where it is not
    armed_ln: float  #: standard error of the logarithm of the time armed

    def loss(self, pixels: Pixels, conditions: Conditions, nodes: Nodes) -> float:
        """Return minus the log-likelihood of the counts and of what is known of the other threshold."""
        mean, error = self.other_ratio
        if self.other is not None:
            mean, error = self.other[0] / pixels.theta, self.other[1] / pixels.theta
        known = 0.5 * ((pixels.other_ratio - mean) / error) ** 2
        return known - log_likelihood(pixels, conditions, self.answers, nodes)


def fit_pixels(data: Data, start: Pixels, conditions: Conditions, *, quick: bool) -> Pixels:
    """Return the pixels that make the counts likeliest; `quick` is good enough for the first of several rounds."""
    from iminuit import Minuit

    nodes = Nodes.for_fit(start, data.answers)

    def loss(*values: float) -> float:
        return data.loss(Pixels(*values), conditions, nodes)

    fit = Minuit(loss, *(getattr(start, name) for name in _NAMES), name=_NAMES)
    fit.errordef = Minuit.LIKELIHOOD
    fit.errors = [0.01 * start.theta, 0.02 * start.noise_rms, 0.1 * start.mismatch, 0.001, 0.03]
    fit.limits = [
        (0.3 * start.theta, 3.0 * start.theta),
        (0.1 * start.noise_rms, 10.0 * start.noise_rms),
        (_LEAST_MISMATCH * start.noise_rms, 10.0 * start.theta),
        (0.1, 1.0),
        (0.3, 3.0),
    ]
    fit.strategy, fit.tol = (0, 10.0) if quick else (1, 0.1)
    fit.migrad()
    return Pixels(*(float(value) for value in fit.values))


@dataclass(frozen=True, slots=True)
class TauFit:
    """The time constant that fits the latencies of given pixels best."""

    tau_s: float
    delay: float  #: of the light and the readout, units of tau
    error_ln: float  #: standard error of ln(tau), widened where the latencies fit badly


def fit_tau(pixels: Pixels, conditions: Conditions, latencies: Latencies, delay: float) -> TauFit | None:
    """Return the time constant and the common delay that fit the latencies best; None where they do not tell.

    Parameters
    ----------
    pixels
        What is held fixed.
    conditions
        Their time constant is where to start.
    latencies
        What is fitted.
    delay
        To start from, units of tau.
    """
    from scipy.optimize import minimize

    model = LatencyModel(pixels, conditions, latencies)
    if not model.free(conditions.tau_s):
        return None

    def deviance(at: Floats) -> float:
        return model.deviance(conditions.tau_s * math.exp(at[0]), float(at[1]))

    best = minimize(
        deviance,
        [0.0, delay],
        method="Nelder-Mead",
        bounds=[(-_TAU_RANGE, _TAU_RANGE), _DELAYS],
        options={"xatol": 3e-4, "fatol": 0.03, "initial_simplex": [[0.0, delay], [0.1, delay], [0.0, delay + 0.05]]},
    )
    tau_s = conditions.tau_s * math.exp(best.x[0])
    poor = max(1.0, float(best.fun) / max(model.free(tau_s), 1))
    return TauFit(tau_s, float(best.x[1]), math.sqrt(poor * _variance_of_first(deviance, best.x)))


def _variance_of_first(deviance: Callable[[Floats], float], at: Floats) -> float:
    """Return the variance of the first of two numbers, from the curvature of a deviance at its minimum."""
    step = 0.02
    e, f = np.array([step, 0.0]), np.array([0.0, step])
    here = deviance(at)
    a = (deviance(at + e) + deviance(at - e) - 2.0 * here) / step**2
    c = (deviance(at + f) + deviance(at - f) - 2.0 * here) / step**2
    same, opposite = (deviance(at + e + s * f) + deviance(at - e - s * f) for s in (1.0, -1.0))
    b = (same - opposite) / (4.0 * step**2)
    determinant = a * c - b * b
    return 2.0 * c / determinant if a > 0.0 and determinant > 0.0 else 1.0


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


def find_errors(data: Data, pixels: Pixels, conditions: Conditions, tau: TauFit) -> Errors | None:
    """Return the errors of a fit; None where the counts leave a parameter open.

    With p the pixels and x = ln(tau), ``dp = dp_counts + A dx + D d ln(armed)`` and ``dx = dx_latencies + B dp``, the
    three sources independent. Counts that fit badly have their part scaled by chi-square per degree of freedom.
    """
    curvature = _Curvature(data, pixels, conditions)
    counts = curvature.covariance()
    if counts is None:
        return None
    chi2, judged = goodness(pixels, conditions, data.answers, curvature.nodes)
    dof = max(judged - _FITTED, 1)
    by_tau = curvature.shift(counts, replace(conditions, tau_s=conditions.tau_s * _TAU_STEP)) / math.log(_TAU_STEP)
    whole = counts * max(1.0, chi2 / dof) + np.outer(by_tau, by_tau) * tau.error_ln**2
    if data.armed_ln > 0.0:
        longer = replace(conditions, armed_s=conditions.armed_s * _ARMED_STEP)
        by_armed = curvature.shift(counts, longer) / math.log(_ARMED_STEP)
        whole += np.outer(by_armed, by_armed) * data.armed_ln**2
    back = _tau_by_pixels(pixels, conditions, data.latencies, tau)
    turn = np.linalg.inv(np.eye(len(_NAMES)) - np.outer(by_tau, back))
    whole = turn @ whole @ turn.T
    theta, noise, mismatch, plateau = (float(v) for v in np.sqrt(np.diag(whole)[:4]) * curvature.free[:4])
    tau_ln = math.sqrt(tau.error_ln**2 + float(back @ whole @ back))
    return Errors(theta, noise, mismatch, plateau, tau_ln, chi2, dof)


class _Curvature:
    """Derivatives of the loss around its minimum."""

    def __init__(self, data: Data, pixels: Pixels, conditions: Conditions) -> None:
        self._data, self._conditions = data, conditions
        self.nodes = Nodes.for_fit(pixels, data.answers)
        self._at = np.array([getattr(pixels, name) for name in _NAMES])
        noise = pixels.noise_rms
        self._step = np.array([0.02 * noise, 0.01 * noise, 0.02 * noise, 3e-4, 0.02])
        self.free = np.array(
            [True, True, pixels.mismatch > _NO_MISMATCH * noise, pixels.plateau < _FULL_PLATEAU, True]
        )

    def _gradient(self, at: Floats, conditions: Conditions) -> Floats:
        gradient = np.zeros(at.size)
        for i in np.flatnonzero(self.free):
            step = np.where(np.arange(at.size) == i, self._step, 0.0)
            up, down = (self._data.loss(Pixels(*(at + s * step)), conditions, self.nodes) for s in (1.0, -1.0))
            gradient[i] = (up - down) / (2.0 * self._step[i])
        return gradient

    def covariance(self) -> Floats | None:
        """Return (5, 5) the covariance from the counts, zero for what is at its bound; None where there is none."""
        size = self._at.size
        hessian = np.zeros((size, size))
        for i in np.flatnonzero(self.free):
            step = np.where(np.arange(size) == i, self._step, 0.0)
            up, down = (self._gradient(self._at + s * step, self._conditions) for s in (1.0, -1.0))
            hessian[i] = (up - down) / (2.0 * self._step[i])
        free = np.ix_(self.free, self.free)
        scale = np.outer(self._step, self._step)[free]
        curvature = 0.5 * (hessian + hessian.T)[free] * scale
        if not _is_determined(curvature):
            return None
        covariance = np.zeros((size, size))
        covariance[free] = np.linalg.inv(curvature) * scale
        return covariance

    def shift(self, covariance: Floats, changed: Conditions) -> Floats:
        """Return (5,) how far the minimum moves under changed conditions."""
        more = self._gradient(self._at, changed) - self._gradient(self._at, self._conditions)
        return np.asarray(-covariance @ more)


def _is_determined(curvature: Floats) -> bool:
    """Return whether a matrix of second derivatives has a minimum at one place, as far as numbers can tell."""
    if not np.isfinite(curvature).all():
        return False
    values = np.linalg.eigvalsh(curvature)
    return bool(values[0] > len(values) * np.finfo(np.float64).eps * values[-1])


def _tau_by_pixels(pixels: Pixels, conditions: Conditions, latencies: Latencies, tau: TauFit) -> Floats:
    """Return (5,) the derivative of the fitted ln(tau) by what latencies depend on."""
    slope = np.zeros(len(_NAMES))
    here = fit_tau(pixels, conditions, latencies, tau.delay)
    for name in _LATENCY_NAMES:
        step = _SMALL if name == "other_ratio" else _SMALL * pixels.noise_rms
        moved = replace(pixels, **{name: getattr(pixels, name) + step})
        there = fit_tau(moved, conditions, latencies, tau.delay)
        if here is not None and there is not None:
            slope[_NAMES.index(name)] = math.log(there.tau_s / here.tau_s) / step
    return slope
