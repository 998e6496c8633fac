"""What a noise-free pixel is expected to do, from its thresholds and its dark light.

All follow from the condition for an event (McReynolds et al., step-response probability curve, eq. "on_event"): with
the dark light E_d, the illuminance that gives the dark current, a step from E_1 to E_2 gives an ON event when
``ln((E_2 + E_d) / (E_1 + E_d)) >= theta_on``, and an OFF event when the same is at or below ``-theta_off``.
Log contrast is ln(E_max / E_min) of the light alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from protocols.points import ResetTestTiming

if TYPE_CHECKING:
    from protocols.points import Point, Settings

__all__ = [
    "Expected",
    "log_response",
    "off_impossible_at_lux",
    "off_log_contrast",
    "on_log_contrast",
    "rearm_log_contrast",
    "reset_return",
]


@dataclass(frozen=True, slots=True)
class Expected:
    """What the sensor is believed to be at some settings; None where nothing is known."""

    theta_on: float | None = None  #: ON threshold, ln units
    theta_off: float | None = None  #: OFF threshold, ln units
    dark_light_lux: float | None = None  #: equivalent dark illuminance E_d, lux
    bandwidth_hz: float | None = None  #: corner of the source follower, Hz
    refractory_s: float | None = None  #: dead time after an event, s

    def under(self, settings: Settings) -> Expected:
        """Return the same with what `settings` prescribe in place of what is believed."""
        return Expected(
            theta_on=_first(settings.theta_on, self.theta_on),
            theta_off=_first(settings.theta_off, self.theta_off),
            dark_light_lux=self.dark_light_lux,
            bandwidth_hz=_first(settings.bandwidth_hz, self.bandwidth_hz),
            refractory_s=_first(settings.refractory_s, self.refractory_s),
        )


def _first(a: float | None, b: float | None) -> float | None:
    return b if a is None else a


def log_response(from_lux: float, to_lux: float, dark_light_lux: float) -> float:
    """Return the change of log photocurrent for a step of the light, ``ln((E_2 + E_d) / (E_1 + E_d))``."""
    return math.log((to_lux + dark_light_lux) / (from_lux + dark_light_lux))


def on_log_contrast(baseline_lux: float, theta: float, dark_light_lux: float) -> float:
    """Return the log contrast at which a step up from `baseline_lux` changes the log photocurrent by `theta`.

    ``ln(1 + (1 + E_d / E) (e^theta - 1))``, the condition for an ON event solved for E_2 / E_1.
    """
    return math.log1p((1.0 + dark_light_lux / baseline_lux) * math.expm1(theta))


def off_log_contrast(baseline_lux: float, theta: float, dark_light_lux: float) -> float:
    """Return the log contrast at which a step down from `baseline_lux` changes the log photocurrent by `theta`.

    ``-ln(e^-theta (1 + E_d / E) - E_d / E)``; infinite where no step down can do it, which is at and below
    :func:`off_impossible_at_lux`.
    """
    ratio = dark_light_lux / baseline_lux
    lowest = math.exp(-theta) * (1.0 + ratio) - ratio
    return -math.log(lowest) if lowest > 0.0 else math.inf


def off_impossible_at_lux(theta_off: float, dark_light_lux: float) -> float:
    """Return the level from which, and below which, even darkness gives no OFF event: ``E_d (e^theta - 1)``, lux."""
    return dark_light_lux * math.expm1(theta_off)


def rearm_log_contrast(
    direction: Literal["up", "down"], baseline_lux: float, theta_on: float, theta_off: float, dark_light_lux: float
) -> float:
    """Return the log contrast at which the return of a reset pulse just gives an event.

    A pulse up returns down to `baseline_lux`, which has to cross `theta_off`; a pulse down returns up, across
    `theta_on`. The return of a pulse changes the log photocurrent as much as its leading edge does, so this is
    :func:`on_log_contrast` with `theta_off`, or :func:`off_log_contrast` with `theta_on`.
    """
    if direction == "up":
        return on_log_contrast(baseline_lux, theta_off, dark_light_lux)
    return off_log_contrast(baseline_lux, theta_on, dark_light_lux)


def reset_return(point: Point, dark_light_lux: float) -> float:
    """Return how much the return of the reset pulse of `point` changes the log photocurrent, ln units, positive.

    The reset re-arms the pixel where this is at least the threshold it has to cross: OFF for a reset pulse that is
    brighter than the baseline, ON for a darker one.
    """
    timing = point.timing
    if not isinstance(timing, ResetTestTiming):
        raise TypeError(f"point {point.index} is a {point.waveform} point and has no reset pulse")
    sign = 1.0 if timing.reset_direction == "up" else -1.0
    reset_lux = point.baseline_lux * math.exp(sign * timing.reset_log_contrast)
    return abs(log_response(reset_lux, point.baseline_lux, dark_light_lux))
