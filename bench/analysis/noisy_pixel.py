"""The threshold from the fit of a noisy pixel.

Noise helps a step over the threshold, so an S-curve lies to the left of it: by three times the noise where a pixel
has fifty time constants to answer in. Fitting the first passage itself (:mod:`bench.analysis.first_passage`) takes
that away. Threshold, spread over the pixels and noise come from the counts of each pixel, the time constant from the
latencies; the two take turns until they agree. Latencies count for no more than that, because their shape also holds
the rise of the light. What the sensor is said to be set to is not used.

The law holds where the reference was memorised at the settled baseline: reset and test pulses, gaps of the refractory
period and several time constants, and a refractory period of several time constants too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.noisy_pixel_fit import Data, Errors, find_errors, fit_pixels, fit_tau
from bench.analysis.noisy_pixel_model import Answers, Conditions, Latencies, Nodes, Pixels, curve
from bench.analysis.results import Estimate

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.analysis.results import ResponseRow

__all__ = ["ThetaFit", "fit_both", "fit_theta", "guess", "reason_against", "time_grid_s"]

_Z90: Final = 1.6448536269514722
_Z99: Final = 2.5758293035489004
_MOST_PIXELS: Final = 4096  # a larger array is represented by this many
_LEAST_PIXELS: Final = 8
_LEAST_RISING: Final = 4  # contrasts on the rise of the curve that a fit needs
_RISE: Final = (0.03, 0.97)  # of the highest share
_LEAST_TOP: Final = 0.7  # the highest share that a fit needs
_LEAST_LATENCIES: Final = 3  # contrasts whose latencies are known
_LEAST_STAMPED: Final = 8  # contrasts from whose latencies a time grid is seen
_OTHER_RATIO: Final = (0.9, 0.25)  # (other threshold / theta) and its error, where nothing is known of it
_ARMED_LN: Final = 0.5  # error of ln(time armed), where it is not known
_ROUNDS: Final = 12
_NEARLY: Final = 0.01  # relative change of tau in a round below which rounds are done with care
_SETTLED: Final = 0.002  # and below which they end
_VAGUE: Final = 0.1  # a standard error of theta above this part of it is no result
_POOR: Final = 2.0  # chi-square per degree of freedom above which the fit is called poor
_COARSE_GRID: Final = 0.05  # a time grid longer than this part of tau is more than a small correction
_CURVE_POINTS: Final = 121
_US_PER_S: Final = 1e6


@dataclass(frozen=True, slots=True)
class ThetaFit:
    """A noisy pixel, as one S-curve shows it. Intervals are 90 % unless said otherwise."""

    theta: Estimate  #: mean threshold of the array, ln units
    noise_rms: Estimate  #: noise at the comparator, ln units
    mismatch: Estimate  #: sigma of the threshold over the pixels, ln units
    corner_hz: Estimate  #: corner of the low-pass
    plateau: Estimate  #: share of the pulses that found the pixel armed
    theta_99: tuple[float, float]  #: 99 % interval of theta
    contrast: npt.NDArray[np.float64]  #: (g,) the fitted curve, for drawing
    probability: npt.NDArray[np.float64]  #: (g,)
    chi2_per_dof: float  #: of the array's counts
    note: str  #: what the fit took for granted, and whether it is poor


def reason_against(rows: Sequence[ResponseRow]) -> str | None:
    """Return why the threshold of a noisy pixel cannot be fitted to the rows of one curve; None if it may be."""
    if any(row.key.waveform != "reset_test" for row in rows):
        return "only reset and test pulses leave a reference that does not depend on the contrast"
    if len({row.per_pixel.size for row in rows}) > 1:
        return "the points have different numbers of pixels"
    if not rows or rows[0].per_pixel.size < _LEAST_PIXELS:
        return f"fewer than {_LEAST_PIXELS} pixels"
    share = np.array([row.probability for row in rows])
    top = float(share.max())
    if not top >= _LEAST_TOP:
        return f"at most {top:.0%} of the pulses were answered; {_LEAST_TOP:.0%} are needed"
    rising = int(np.sum((share > _RISE[0] * top) & (share < _RISE[1] * top)))
    if rising < _LEAST_RISING or share.min() > 0.5 * top:
        return f"{rising} contrasts on the rise of the curve; {_LEAST_RISING} are needed, with one below its middle"
    if not any(row.latency_counts.any() for row in rows):
        return "there are no latencies, for want of triggers"
    if Latencies.of(rows).contrast.size < _LEAST_LATENCIES:
        return "too few answers to tell the time constant from their latencies"
    return None


def time_grid_s(rows: Sequence[ResponseRow]) -> float:
    """Return the time step of comparators that do not look all the time, as the latencies show it; 0 for others.

    Time stamps count microseconds. Where the medians and the interquartile ranges of all latencies are multiples of a
    longer step, the sensor looks, or is simulated, at that step. Fewer than eight rows could be so by chance.
    """
    answered = [row for row in rows if row.latency_counts.any()]
    seen_us = np.array([v * _US_PER_S for row in answered for v in (row.latency_median_s, row.latency_iqr_s)])
    whole = np.rint(seen_us)
    if len(answered) < _LEAST_STAMPED or not np.allclose(seen_us, whole, rtol=0.0, atol=0.01):
        return 0.0
    step_us = int(np.gcd.reduce(whole.astype(np.int64)))
    return step_us / _US_PER_S if step_us > 1 else 0.0


def fit_theta(
    rows: Sequence[ResponseRow],
    *,
    seed: int = 0,
    other: Estimate | None = None,
    window_s: float | None = None,
    armed_s: float | None = None,
    grid_s: float | None = None,
) -> ThetaFit | None:
    """Fit threshold, mismatch, noise and corner of an array to the rows of one reset/test curve.

    Parameters
    ----------
    rows
        The answers to one curve's contrasts, in any order. `latency_edges_s` reach to the end of the response window
        unless `window_s` says otherwise, and are several to a time constant.
    seed
        Chooses 4096 pixels of an array that has more.
    other
        Threshold of the other polarity, ln units, from other data than these rows. The noise events over it, while
        the pixel waits, thin out the references that are farthest from the threshold under test. Without it, it is
        taken as 0.9 +/- 0.25 of the threshold under test and fitted along. It helps only together with `armed_s`;
        then the interval is about a third narrower.
    window_s
        Length of the response window.
    armed_s
        Time from the memorising of the reference to the step: the gap less the refractory period. Without it, the
        length of the window, within a factor of e^0.5.
    grid_s
        Time between two looks of the comparators, 0 for a sensor whose comparators never look away; without it, what
        :func:`time_grid_s` finds. A grid acts as thresholds that are 0.58 rms sqrt(2 grid / tau) higher, and theta is
        given without that: 1.5 % at theta / rms = 6, 200 Hz and 10 us.

    Returns
    -------
    ThetaFit or None
        None where the data do not determine it; in most cases :func:`reason_against` says why.
    """
    if reason_against(rows) is not None:
        return None
    rows = sorted(rows, key=lambda row: row.log_contrast)
    grid = time_grid_s(rows) if grid_s is None else grid_s
    data = Data(
        answers=Answers.of(rows, _MOST_PIXELS, seed),
        latencies=Latencies.of(rows, grid),
        other=None if other is None else (other.value, 0.5 * (other.high - other.low) / _Z90),
        other_ratio=_OTHER_RATIO,
        armed_ln=_ARMED_LN if armed_s is None else 0.0,
    )
    window = float(rows[0].latency_edges_s[-1]) if window_s is None else window_s
    start, tau_s = guess(rows)
    conditions = Conditions(tau_s, window, window if armed_s is None else armed_s, grid)
    return _take_turns(data, start, conditions)


def fit_both(
    on: Sequence[ResponseRow],
    off: Sequence[ResponseRow],
    *,
    armed_s: float,
    seed: int = 0,
    window_s: float | None = None,
    grid_s: float | None = None,
) -> tuple[ThetaFit | None, ThetaFit | None]:
    """Fit an ON and an OFF curve that were taken at the same settings, each with the other's threshold at hand.

    Each is first fitted alone; then each again, with what the first fit of the other says of its threshold.
    Parameters as for :func:`fit_theta`.
    """
    first = [fit_theta(rows, seed=seed, window_s=window_s, armed_s=armed_s, grid_s=grid_s) for rows in (on, off)]
    if first[0] is None or first[1] is None:
        return first[0], first[1]
    again = [
        fit_theta(rows, seed=seed, other=known.theta, window_s=window_s, armed_s=armed_s, grid_s=grid_s)
        for rows, known in ((on, first[1]), (off, first[0]))
    ]
    return again[0] or first[0], again[1] or first[1]


def guess(rows: Sequence[ResponseRow]) -> tuple[Pixels, float]:
    """Return pixels and a time constant to start from: the curve's middle lies about 2.8 rms below the threshold."""
    contrast = np.array([row.log_contrast for row in rows])
    share = np.maximum.accumulate([row.probability for row in rows])
    share = share + 1e-9 * np.arange(share.size)  # a rank where shares are equal
    middle, high = (float(np.interp(q * share[-1], share, contrast)) for q in (0.5, 0.84))
    noise = 0.85 * max(high - middle, 1e-3)
    theta = middle + 2.8 * noise
    largest = [row for row in rows if row.latency_counts.any()][-1]
    left = max(largest.log_contrast - theta + noise, 0.1 * largest.log_contrast)
    tau_s = max(largest.latency_median_s, 1.0 / _US_PER_S) / math.log(largest.log_contrast / left)
    return Pixels(theta, noise, 0.3 * noise, min(float(share[-1]), 0.999), _OTHER_RATIO[0]), tau_s


def _take_turns(data: Data, start: Pixels, conditions: Conditions) -> ThetaFit | None:
    """Fit the pixels with tau fixed, tau with the pixels fixed, and again, until tau stays."""
    pixels, delay, moved = start, 0.05, math.inf
    for _ in range(_ROUNDS):
        quick = moved > _NEARLY
        pixels = fit_pixels(data, pixels, conditions, quick=quick)
        tau = fit_tau(pixels, conditions, data.latencies, delay)
        if tau is None:
            return None
        moved = abs(math.log(tau.tau_s / conditions.tau_s))
        if moved < _SETTLED and not quick:
            break
        conditions, delay = replace(conditions, tau_s=tau.tau_s), tau.delay
    else:
        return None
    errors = find_errors(data, pixels, conditions, tau)
    if errors is None or not errors.theta < _VAGUE * pixels.theta:
        return None
    return _result(data, pixels, conditions, errors)


def _result(data: Data, pixels: Pixels, conditions: Conditions, errors: Errors) -> ThetaFit:
    contrast = np.linspace(0.0, float(data.answers.contrast[-1]), _CURVE_POINTS)
    corner, factor = 1.0 / (2.0 * math.pi * conditions.tau_s), math.exp(_Z90 * errors.tau_ln)
    note = _note(data, conditions, errors)
    return ThetaFit(
        theta=_estimate(pixels.theta, errors.theta, "ln", note),
        noise_rms=_estimate(pixels.noise_rms, errors.noise_rms, "ln", note),
        mismatch=_mismatch(pixels, errors),
        corner_hz=Estimate(corner, corner / factor, corner * factor, "Hz", note),
        plateau=_estimate(pixels.plateau, errors.plateau, "1"),
        theta_99=(pixels.theta - _Z99 * errors.theta, pixels.theta + _Z99 * errors.theta),
        contrast=contrast,
        probability=curve(pixels, conditions, contrast, Nodes.for_fit(pixels, data.answers)),
        chi2_per_dof=errors.chi2 / errors.dof,
        note=note,
    )


def _estimate(value: float, error: float, unit: str, note: str = "") -> Estimate:
    return Estimate(value, value - _Z90 * error, value + _Z90 * error, unit, note)


def _mismatch(pixels: Pixels, errors: Errors) -> Estimate:
    if errors.mismatch > 0.0:
        low = max(0.0, pixels.mismatch - _Z90 * errors.mismatch)
        return Estimate(pixels.mismatch, low, pixels.mismatch + _Z90 * errors.mismatch, "ln")
    return Estimate(0.0, 0.0, float("nan"), "ln", "none seen")


def _note(data: Data, conditions: Conditions, errors: Errors) -> str:
    parts = []
    if data.other is None:
        parts.append("threshold of the other polarity fitted along")
    if data.armed_ln > 0.0:
        parts.append("time armed taken as the response window")
    if conditions.grid_s > 0.0:
        parts.append(f"comparators taken to look every {conditions.grid_s * _US_PER_S:g} us")
    if conditions.grid_s > _COARSE_GRID * conditions.tau_s:
        parts.append("which is coarse for the time constant found: theta may be a few per cent low")
    if errors.chi2 > _POOR * errors.dof:
        parts.append(f"poor fit (chi-square {errors.chi2 / errors.dof:.1f} per degree of freedom), interval widened")
    return "; ".join(parts)
