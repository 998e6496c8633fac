"""The rms of the noise that gives a background rate: by counting events, for a plain pixel also without."""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench.analysis.intervals import rate_interval
from bench.models.noise_chain import lasting_rate, nodes_needed, settling_intervals
from bench.models.noise_recording import Bench
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from bench.models.noise_recording import Step
    from sim_backend.pixel import PixelModel

    Counts = npt.NDArray[np.int64]

__all__ = ["CountedRate", "NoiseCalibration", "calibrate_noise", "matrix_rms"]

#: Noise levels at which is counted, over the one thought right.
_AROUND: Final = (0.97, 1.0, 1.03)
#: Events wanted at each of them, and in a first look.
_EVENTS: Final = 4000.0
_LOOK_EVENTS: Final = 400.0
_MOST_LOOKS: Final = 30
_MOST_ROUNDS: Final = 6
#: A first look is near enough if its rate is this factor from the target, or closer.
_NEAR: Final = 1.6
#: Groups of pixels that are left out in turn, for the error.
_GROUPS: Final = 32
#: A glance at effects alone, pixel seconds, before a recording as long as a low target asks for; and how far above
#: the target their rate must be to end the search there: what is left of the reset is far below that.
_GLANCE_PIXEL_S: Final = 4000.0
_FAR_TOO_MANY: Final = 100.0
#: The rate may be this far above the lasting one when counting begins.
_EXCESS: Final = 0.01
#: The matrix is left out where it would have more nodes: a second and more for each level of noise.
_MOST_NODES: Final = 600
#: Levels of noise looked at, as threshold over rms: beyond the first, noise gives no event; the last is rms 1.
_QUIETEST: Final = 40.0
_LOUDEST_RMS: Final = 1.0
#: Threshold over rms beyond which the transition matrix has too few digits.
_SLOWEST: Final = 7.5
#: Mean intervals to wait where the transition matrix is not there to say it.
_WAIT_INTERVALS: Final = 10.0
#: A standard error above this part of the rms is worth a word.
_LARGE_ERROR: Final = 0.02


@dataclass(frozen=True, slots=True)
class CountedRate:
    """The background rate that was counted at one level of noise."""

    rms: float  #: ln units
    rate_hz: float  #: per pixel, ON and OFF together
    low_hz: float  #: of the 90 % interval
    high_hz: float
    events: int


@dataclass(frozen=True, slots=True)
class NoiseCalibration:
    """The noise that gives a background rate."""

    target_hz: float
    rms: float  #: ln units, behind the source follower
    rms_error: float  #: standard error
    slope: float  #: d ln rate / d ln rms at the target
    slope_error: float  #: standard error
    reached: CountedRate  #: counted at `rms`, with other random numbers
    counted: tuple[CountedRate, ...]  #: what the result was found from
    matrix_rms: float | None  #: from the transition matrix, which draws nothing; None where it does not apply
    wait_s: float  #: from the reset to the first event that counts
    seconds: float  #: for which events were counted, in each recording
    pixels: int
    took_s: float
    warnings: tuple[str, ...]

    @property
    def events(self) -> int:
        """Events that the result was found from."""
        return sum(c.events for c in self.counted)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data, for programs."""
        return {"format": "evs-bench-noise/1", **asdict(self), "events": self.events}


def calibrate_noise(
    model: PixelModel,
    target_hz: float,
    *,
    lux: float,
    dt_s: float = 1e-5,
    step: Step = "exact",
    pixels: int = 512,
    seconds: float | None = None,
    wait_s: float | None = None,
    seed: int = 1,
    tell: Callable[[str], None] | None = None,
) -> NoiseCalibration:
    """Find the rms of the noise with which `model` has the background rate `target_hz`.

    Events are counted at three levels of noise around the one sought, with common random numbers. A straight line is
    laid through the logarithm of the rate over 1 / rms^2 (a noise event is a passage over a barrier: H. A. Kramers,
    Physica 7, 1940). The errors leave out groups of pixels in turn (delete-a-group jackknife), so bursts of a pixel,
    frozen differences between pixels and common random numbers are in them; pixels count as independent.

    Parameters
    ----------
    model
        The pixel; its own `noise_rms` is not looked at.
    target_hz
        Events per pixel and second, ON and OFF together.
    lux
        Illuminance on the chip, lux.
    dt_s
        Length of a sample, s.
    step
        "exact", or "euler" as in the published simulation.
    pixels
        How many are simulated.
    seconds
        For which events are counted in each recording; None for about 4000 events.
    wait_s
        From the reset until events count; None for as long as the rate of the plain pixel takes to come within 1 %
        of the lasting one. With 0 it is the rate of a recording of `seconds`.
    seed
        Another seed, other events.
    tell
        Called with a line for each thing that is done.

    Raises
    ------
    InputError
        An argument is out of range, or no noise gives this rate.
    """
    began = time.monotonic()
    bench = Bench(model, lux, dt_s, step, pixels, seed)
    _check_target(bench, target_hz)
    search = _Search(bench, target_hz, seconds, wait_s, tell or _nowhere)
    found = search.find()
    reached = _rate(found.rms, search.count(found.rms, _MOST_LOOKS), search.seconds)
    return NoiseCalibration(
        target_hz=target_hz,
        rms=found.rms,
        rms_error=found.rms_error,
        slope=found.slope,
        slope_error=found.slope_error,
        reached=reached,
        counted=found.counted,
        matrix_rms=search.matrix_rms if not model.effects and wait_s is None else None,
        wait_s=search.wait_s,
        seconds=search.seconds,
        pixels=pixels,
        took_s=time.monotonic() - began,
        warnings=_warnings(found, reached, target_hz),
    )


def matrix_rms(bench: Bench, target_hz: float) -> float | None:
    """Return the rms for a lasting rate from the transition matrix, for the base pixel; None if it is too large."""
    theta = min(bench.model.theta_on, bench.model.theta_off)
    rho, wanted = bench.rho(), math.log(target_hz * bench.dt_s)

    def log_rate(a: float) -> float:
        on, off = (a * t / theta for t in (bench.model.theta_on, bench.model.theta_off))
        return math.log(lasting_rate(on, off, rho, bench.dead_samples))

    if nodes_needed(_SLOWEST, _SLOWEST * max(bench.model.theta_on, bench.model.theta_off) / theta, rho) > _MOST_NODES:
        return None
    (a, y), (b, z) = ((a, log_rate(a) - wanted) for a in (5.0, 5.3))
    for _ in range(20):
        if abs(z) < 1e-6:
            return theta / b
        if y == z:
            return None
        # A secant in a^2, in which the logarithm of the rate is nearly straight.
        square = b * b - z * (b * b - a * a) / (z - y)
        a, y, b = b, z, math.sqrt(min(max(square, 0.5 * b * b), 1.5 * b * b))
        if not 0.5 < b < _SLOWEST:
            return None
        z = log_rate(b) - wanted
    return None


@dataclass(frozen=True, slots=True)
class _Found:
    rms: float
    rms_error: float
    slope: float
    slope_error: float
    counted: tuple[CountedRate, ...]


class _Search:
    """Counting at levels of noise, closer and closer to the one sought."""

    def __init__(
        self,
        bench: Bench,
        target_hz: float,
        seconds: float | None,
        wait_s: float | None,
        tell: Callable[[str], None],
    ) -> None:
        self._bench, self._target_hz, self._tell = bench, target_hz, tell
        self._theta = min(bench.model.theta_on, bench.model.theta_off)
        self.matrix_rms = matrix_rms(bench, target_hz)
        if self.matrix_rms is not None:
            tell(f"transition matrix of the base pixel: rms {self.matrix_rms:.5f} ln")
        self.seconds = seconds if seconds is not None else max(_EVENTS / bench.pixels, 2.0) / target_hz
        self.wait_s = wait_s if wait_s is not None else self._settling_s()

    def find(self) -> _Found:
        """Return the noise with which the rate is the target."""
        rms = self.matrix_rms or self._theta / 5.0
        if self._bench.model.effects or self.matrix_rms is None or self.wait_s == 0.0:
            rms = self._look(rms)
        for round_number in range(_MOST_ROUNDS):
            levels = [f * rms for f in _AROUND]
            self._tell(f"counting at rms {', '.join(f'{level:.5f}' for level in levels)} ln")
            found = _fit(levels, [self.count(level, round_number) for level in levels], self.seconds, self._target_hz)
            if abs(math.log(found.rms / rms)) <= math.log(_AROUND[-1]) or found.rms_error > 0.5 * rms:
                return found
            rms = min(max(found.rms, 0.8 * rms), 1.25 * rms)
        raise InputError(
            f"calibrate-noise: the rate around rms {rms:.4g} ln does not settle at {self._target_hz:g} Hz; "
            "count for longer (--seconds) or with more pixels (--pixels)"
        )

    def count(self, rms: float, recording: int, share: float = 1.0) -> Counts:
        """Return the events of each pixel at one level of noise."""
        return self._bench.counts(rms, self.wait_s, share * self.seconds, recording)

    def _settling_s(self) -> float:
        """Return how long the rate of the base pixel takes to come down to the lasting one, s."""
        m, rms = self._bench.model, self.matrix_rms
        if rms is None:
            return _WAIT_INTERVALS / self._target_hz
        rho, dead = self._bench.rho(), self._bench.dead_samples
        return settling_intervals(m.theta_on / rms, m.theta_off / rms, rho, dead, _EXCESS) / self._target_hz

    def _look(self, rms: float) -> float:
        """Return a level of noise with about the rate sought, from short recordings."""
        quiet, loud = self._theta / _QUIETEST, _LOUDEST_RMS
        low, high = quiet, loud
        self._glance(quiet)
        share = min(1.0, _LOOK_EVENTS / _EVENTS)
        for look in range(_MOST_LOOKS):
            rate_hz = max(float(self.count(rms, look, share).sum()), 0.5) / (
                self._bench.pixels * share * self.seconds
            )
            self._tell(f"a look at rms {rms:.5f} ln: {rate_hz:.3g} Hz")
            gap = math.log(self._target_hz / rate_hz)
            if abs(gap) < math.log(_NEAR):
                return rms
            low, high = (rms, high) if gap > 0.0 else (low, rms)
            if high <= 1.001 * quiet:
                raise InputError(_without_noise(self._bench, rate_hz, self._target_hz))
            if low >= 0.999 * loud:
                raise InputError(_too_much(self._bench, rate_hz, self._target_hz))
            # ln rate goes as -(theta / rms)^2 / 2; where other events flatten it the steps double.
            stride = gap * (rms / self._theta) ** 2 * 2.0**look
            guess = rms * math.exp(min(max(stride, -0.5), 0.5))
            inside = low < guess < high
            end = quiet if gap < 0.0 and low == quiet else loud if gap > 0.0 and high == loud else None
            rms = guess if inside else end if end is not None else math.sqrt(low * high)
        return rms

    def _glance(self, quiet: float) -> None:
        """Refuse a target far below the rate that effects alone give, before hours are spent to see it."""
        seconds = _GLANCE_PIXEL_S / self._bench.pixels
        if not self._bench.model.effects or seconds > self.wait_s + self.seconds:
            return
        counts = self._bench.counts(quiet, 0.5 * seconds, 0.5 * seconds, _MOST_LOOKS + 1)
        rate_hz, low_hz, _ = rate_interval(counts, 0.5 * seconds)
        if low_hz > _FAR_TOO_MANY * self._target_hz:
            raise InputError(_without_noise(self._bench, rate_hz, self._target_hz))


def _without_noise(bench: Bench, rate_hz: float, target_hz: float) -> str:
    names = ", ".join(e.id for e in bench.model.effects) or "the pixel"
    return (
        f"calibrate-noise: without this noise the pixel already has {rate_hz:.3g} Hz ({names}), more than the "
        f"{target_hz:g} Hz wanted; there is nothing for noise to add"
    )


def _too_much(bench: Bench, rate_hz: float, target_hz: float) -> str:
    return (
        f"calibrate-noise: even noise of {_LOUDEST_RMS:g} ln gives only {rate_hz:.3g} Hz with a refractory period of "
        f"{bench.model.refractory_s:g} s, less than the {target_hz:g} Hz wanted"
    )


def _check_target(bench: Bench, target_hz: float) -> None:
    if not 0.0 < target_hz < math.inf:
        raise InputError(f"calibrate-noise: the target is {target_hz:g} Hz; expected more than 0")
    most_hz = 1.0 / ((bench.dead_samples + 1) * bench.dt_s)
    if target_hz >= most_hz:
        raise InputError(
            f"calibrate-noise: with a refractory period of {bench.model.refractory_s:g} s and samples of "
            f"{bench.dt_s:g} s no pixel has more than {most_hz:.4g} Hz; {target_hz:g} Hz is beyond what noise can do"
        )


def _fit(levels: list[float], counts: list[Counts], seconds: float, target_hz: float) -> _Found:
    """Return where a straight line through log rate over 1 / rms^2 meets the target, and its errors."""
    table = np.array(counts, np.float64)
    whole = _line(levels, table, seconds, target_hz)
    groups = min(_GROUPS, table.shape[1])
    group = np.arange(table.shape[1]) * groups // table.shape[1]
    without = np.array([_line(levels, table[:, group != g], seconds, target_hz) for g in range(groups)])
    error = np.sqrt((groups - 1.0) * np.var(without, axis=0))
    log_rms, slope = whole
    counted = tuple(_rate(level, n, seconds) for level, n in zip(levels, counts, strict=True))
    rms = math.exp(log_rms)
    return _Found(rms, rms * float(error[0]), slope, float(error[1]), counted)


def _line(
    levels: list[float], table: npt.NDArray[np.float64], seconds: float, target_hz: float
) -> tuple[float, float]:
    """Return ln rms at the target, and d ln rate / d ln rms there, from counts of (levels, pixels)."""
    # Half an event stands for none: such a level only says that the target is far away.
    rate_hz = np.maximum(table.sum(axis=1), 0.5) / (table.shape[1] * seconds)
    x = 1.0 / np.square(levels)
    y = np.log(rate_hz / target_hz)
    slope = float(np.sum((x - x.mean()) * (y - y.mean())) / np.sum((x - x.mean()) ** 2))
    if slope >= 0.0:
        raise InputError(
            "calibrate-noise: the rate does not grow with the noise here; other events hide it: count for longer "
            "(--seconds), or with more pixels (--pixels)"
        )
    at = max(float(x.mean() - y.mean() / slope), 0.25 * float(x.min()))
    return -0.5 * math.log(at), -2.0 * at * slope


def _rate(rms: float, counts: Counts, seconds: float) -> CountedRate:
    rate_hz, low_hz, high_hz = rate_interval(counts, seconds)
    return CountedRate(rms, rate_hz, low_hz, high_hz, int(counts.sum()))


def _warnings(found: _Found, reached: CountedRate, target_hz: float) -> tuple[str, ...]:
    warnings = []
    if found.rms_error > _LARGE_ERROR * found.rms:
        warnings.append(
            f"the noise is known to {100.0 * found.rms_error / found.rms:.1f} % only; count for longer (--seconds)"
        )
    if not 0.8 * reached.low_hz <= target_hz <= 1.25 * reached.high_hz:
        warnings.append(f"counted again, the rate is {reached.rate_hz:.3g} Hz instead of {target_hz:g} Hz")
    return tuple(warnings)


def _nowhere(_line: str) -> None:
    pass
