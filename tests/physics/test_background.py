"""Background events of a noisy pixel, against numbers that no engine made."""

from __future__ import annotations

import math
from collections import defaultdict
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import erf, erfcx

from protocols.points import Roi
from sim_backend.pixel import PixelModel

if TYPE_CHECKING:
    import numpy.typing as npt

    from tests.physics.conftest import Record

    Step = Literal["exact", "euler"]

THETA = 0.3
DT_S = 1e-5
ROI = Roi(0, 0, 16, 8)
LUX = 10.0


def noisy(corner_hz: float, refractory_s: float, rms: float) -> PixelModel:
    return PixelModel(noise_rms=rms, corner_hz=corner_hz, theta_on=THETA, theta_off=THETA, refractory_s=refractory_s)


def tau_of(corner_hz: float) -> float:
    return 1.0 / (2.0 * math.pi * corner_hz)


def per_pixel(events: npt.NDArray[np.void]) -> npt.NDArray[np.int64]:
    return np.bincount(events["y"].astype(int) * ROI.width + events["x"], minlength=ROI.pixels)


# First passage on the grid of samples


legendre = lru_cache(np.polynomial.legendre.leggauss)


def mean_exit_samples(reference: float, a: float, rho: float) -> float:
    """Return the mean number of samples until x leaves (reference - a, reference + a), from x = reference.

    ``x' = rho x + sqrt(1 - rho^2) z``. The mean T(x) obeys ``T = 1 + P T`` with the transition matrix P within the
    interval, here on Gauss-Legendre nodes, a quarter of the step of the noise apart in the mean.
    """
    s = math.sqrt(1.0 - rho * rho)
    unit, weight = legendre(math.ceil(8.0 * a / s))
    x = reference + a * unit

    def transition(start: Any) -> npt.NDArray[np.float64]:
        density = np.exp(-0.5 * ((x - rho * start) / s) ** 2) / (s * math.sqrt(2.0 * math.pi))
        return np.asarray(a * weight * density)

    inside = transition(x[:, None])
    samples = np.linalg.solve(np.eye(len(x)) - inside, np.ones(len(x)))
    return float(1.0 + transition(reference) @ samples)


def first_passage_hz(a: float, corner_hz: float, refractory_s: float, rho: float) -> float:
    """Return the rate of events if each reference is drawn anew from the stationary law of the noise.

    Both sides of that law are alike; the trapezoidal rule is exact enough, the integrand has the width 1/a.
    """
    step = 0.2
    reference = np.arange(0.0, 5.5, step)
    weight = 2.0 * step * np.exp(-0.5 * reference**2) / math.sqrt(2.0 * math.pi)
    weight[0] /= 2.0
    samples = [mean_exit_samples(r, a, rho) for r in reference]
    return float(1.0 / (DT_S * (round(refractory_s / DT_S) + np.dot(weight, samples))))


@pytest.mark.slow
@pytest.mark.parametrize("step", ["exact", "euler"])
@pytest.mark.parametrize(
    ("corner_hz", "refractory_s", "a", "duration_s"),
    [(50.0, 1e-2, 3.4, 50.0), (200.0, 2.5e-3, 3.7, 30.0), (2000.0, 2.5e-4, 4.0, 20.0), (2000.0, 1e-2, 4.0, 20.0)],
)
def test_the_rate_is_that_of_first_passage(
    record: Record, corner_hz: float, refractory_s: float, a: float, duration_s: float, step: Step
) -> None:
    assert refractory_s >= 3.0 * tau_of(corner_hz)
    rho = math.exp(-DT_S / tau_of(corner_hz)) if step == "exact" else 1.0 - DT_S / tau_of(corner_hz)
    expected_hz = first_passage_hz(a, corner_hz, refractory_s, rho)
    model = noisy(corner_hz, refractory_s, THETA / a)
    counts = per_pixel(record(model, LUX, duration_s, wait_s=3.0 / expected_hz, roi=ROI, step=step))
    measured_hz = counts.mean() / duration_s
    error_hz = counts.std() / math.sqrt(ROI.pixels) / duration_s
    assert error_hz < 0.0125 * expected_hz  # so that 5 % is four sigma
    assert measured_hz == pytest.approx(expected_hz, rel=0.05)


# Closed form of continuous time


def closed_form_on_hz(a: float, tau_s: float) -> float:
    """Return ``(1 / tau) / (T_exit + T_ret)``: the reference is the mean of the noise, time is continuous."""
    exit_time = quad(lambda y: math.exp(y * y / 2.0) * math.sqrt(math.pi / 2.0) * erf(y / math.sqrt(2.0)), 0.0, a)[0]
    return_time = quad(lambda y: math.sqrt(math.pi / 2.0) * erfcx(y / math.sqrt(2.0)), 0.0, a)[0]
    return float(1.0 / (tau_s * (exit_time + return_time)))


@pytest.mark.parametrize("corner_hz", [50.0, 200.0, 2000.0])
def test_the_closed_form_is_near(record: Record, corner_hz: float) -> None:
    """On the grid the barrier is higher, and the reference is noisy: 0.5 (2 kHz) to 1.3 (50 Hz) times at a = 4."""
    tau_s = tau_of(corner_hz)
    closed_hz = closed_form_on_hz(4.0, tau_s)
    duration_s = 1500.0 / closed_hz / ROI.pixels
    model = noisy(corner_hz, 10.0 * tau_s, THETA / 4.0)
    events = record(model, LUX, duration_s, wait_s=2.0 / closed_hz, roi=ROI)
    on = int(np.sum(events["p"] == 1))
    off = len(events) - on
    assert abs(on - off) < 4.0 * math.sqrt(on + off)
    ratio = on / duration_s / ROI.pixels / closed_hz
    low, high = {50.0: (1.05, 1.4), 200.0: (0.8, 1.2), 2000.0: (0.4, 0.65)}[corner_hz]
    assert low < ratio < high


# Which polarity follows which


@pytest.mark.parametrize(("refractory_taus", "expected"), [(0.0, 0.010), (10.0, 0.487)])
def test_the_polarity_that_follows_measures_refractory_times_bandwidth(
    record: Record, refractory_taus: float, expected: float
) -> None:
    tau_s = tau_of(200.0)
    model = noisy(200.0, refractory_taus * tau_s, THETA / 4.0)
    events = record(model, LUX, 10.0, wait_s=1.0, roi=ROI)
    polarities = defaultdict(list)
    for pixel, polarity in zip(events["y"].astype(int) * ROI.width + events["x"], events["p"], strict=True):
        polarities[pixel].append(polarity)
    same = np.concatenate([np.diff(np.array(p, int)) == 0 for p in polarities.values()])
    assert len(same) > 2000
    error = math.sqrt(expected * (1.0 - expected) / len(same))
    # The figures are of a simulation with its own error, to about a hundredth.
    assert np.mean(same) == pytest.approx(expected, abs=0.005 + 4.0 * error)


# The published noise levels

# corner in Hz, refractory period in s, rate wanted in Hz, rms that gives it
NOISE_TABLE = [
    (2000.0, 1e-4, 0.5, 0.0612),
    (2000.0, 1e-4, 0.02, 0.0536),
    (2000.0, 1e-2, 0.5, 0.0628),
    (2000.0, 1e-2, 0.02, 0.0541),
    (200.0, 1e-2, 0.5, 0.0673),
    (200.0, 1e-2, 0.02, 0.0582),
    (50.0, 1e-2, 0.5, 0.0724),
    (50.0, 1e-2, 0.02, 0.0607),
]


def check_table_entry(
    record: Record,
    corner_hz: float,
    refractory_s: float,
    target_hz: float,
    rms: float,
    step: Step,
    wait_s: float,
    duration_s: float,
) -> None:
    """3 % less noise gives fewer events than wanted, 3 % more gives more, by more than the counting error."""
    wanted = target_hz * duration_s * ROI.pixels
    for factor, sign in ((0.97, -1), (1.03, 1)):
        model = noisy(corner_hz, refractory_s, factor * rms)
        counts = per_pixel(record(model, LUX, duration_s, wait_s=wait_s, roi=ROI, step=step, seed=7))
        error = max(counts.std() * math.sqrt(ROI.pixels), math.sqrt(counts.sum()))
        assert sign * (counts.sum() - wanted) > 2.5 * error, (factor, counts.sum(), wanted)


@pytest.mark.parametrize("step", ["exact", "euler"])
@pytest.mark.parametrize(("corner_hz", "refractory_s", "target_hz", "rms"), [e for e in NOISE_TABLE if e[2] == 0.5])
def test_noise_for_half_an_event_per_second(
    record: Record, corner_hz: float, refractory_s: float, target_hz: float, rms: float, step: Step
) -> None:
    check_table_entry(record, corner_hz, refractory_s, target_hz, rms, step, wait_s=4.0, duration_s=10.0)


@pytest.mark.slow
@pytest.mark.parametrize(("corner_hz", "refractory_s", "target_hz", "rms"), [e for e in NOISE_TABLE if e[2] == 0.02])
def test_noise_for_an_event_in_fifty_seconds(
    record: Record, corner_hz: float, refractory_s: float, target_hz: float, rms: float
) -> None:
    # After the reset at t = 0 the rate falls for a few mean intervals: pixels that memorised an outlier go first.
    tight = (corner_hz, refractory_s) == (2000.0, 1e-2)
    check_table_entry(
        record, corner_hz, refractory_s, target_hz, rms, "exact", wait_s=100.0, duration_s=220.0 if tight else 80.0
    )
