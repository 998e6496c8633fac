"""A measurement point: everything that is needed to take one recording, and nothing else.

Points are what :func:`protocols.expand` makes of a protocol. They are plain frozen dataclasses, so they can be
compared, hashed, printed and sent to another process.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

__all__ = [
    "ConstantTiming",
    "Point",
    "Polarity",
    "Preamble",
    "ResetTestTiming",
    "Roi",
    "Settings",
    "Settle",
    "SquareTiming",
    "Timing",
    "Waveform",
]

Polarity = Literal["on", "off", "both"]
Waveform = Literal["square", "reset_test", "constant"]
Ambient = Literal["open", "shrouded", "capped"]


@dataclass(frozen=True, slots=True)
class Roi:
    """A window of pixels, in sensor coordinates; `x` and `y` are the first column and row."""

    x: int
    y: int
    width: int
    height: int

    @property
    def pixels(self) -> int:
        """Number of pixels in the window."""
        return self.width * self.height


@dataclass(frozen=True, slots=True)
class Settings:
    """What the sensor is asked to be: physical values (through the station's bias map) and raw bias offsets.

    A physical value of None leaves the bias where `biases` or the camera's default puts it.
    """

    theta_on: float | None = None  #: ON threshold, ln units
    theta_off: float | None = None  #: OFF threshold, ln units
    refractory_s: float | None = None  #: dead time after an event, s
    bandwidth_hz: float | None = None  #: corner of the source follower, Hz
    biases: tuple[tuple[str, int], ...] = ()  #: offsets from the factory codes, by bias name, sorted


@dataclass(frozen=True, slots=True)
class Settle:
    """How long to wait, in seconds, before a recording starts."""

    light_s: float = 0.2  #: after the light went to the first level of the point
    filter_s: float = 0.5  #: more, after the ND filter moved
    bias_s: float = 0.5  #: more, after a bias or the window changed


@dataclass(frozen=True, slots=True)
class Preamble:
    """Pulses with unequal gaps before the first pulse, by which a recording without triggers is put in its place."""

    log_contrast: float  #: ln(E_max / E_min) of its pulses, which are brighter than the first level
    edges: int = 8  #: 4, 6, 8 or 10
    unit_s: float = 0.04  #: the shortest gap, s


@dataclass(frozen=True, slots=True)
class SquareTiming:
    """A periodic square wave; every period is a dark part, then a bright part of `duty` of the period."""

    frequency_hz: float
    duty: float


@dataclass(frozen=True, slots=True)
class ResetTestTiming:
    """One period: baseline for `gap_s`, reset for `reset_s`, baseline for `gap_s`, test for `test_s`."""

    gap_s: float
    reset_s: float
    reset_log_contrast: float  #: ln(E_max / E_min) of the reset pulse
    reset_direction: Literal["up", "down"]  #: up: the reset is brighter than the baseline
    test_s: float
    window_s: float  #: response window, counted from the leading edge of the test pulse


@dataclass(frozen=True, slots=True)
class ConstantTiming:
    """One level for `duration_s`."""

    duration_s: float


Timing = SquareTiming | ResetTestTiming | ConstantTiming


@dataclass(frozen=True, slots=True)
class Point:
    """One recording at fixed settings."""

    index: int  #: position in the plan, from 0
    measurement: str  #: name of the measurement in the protocol
    waveform: Waveform
    polarity: Polarity
    baseline_lux: float  #: on-chip illuminance from which the test pulse steps, lux
    log_contrast: float  #: ln(E_max / E_min) of the test pulse; 0 for a constant point
    pulses: int  #: test pulses; for a square wave, periods; 0 for a constant point
    timing: Timing
    roi: Roi
    nd_od: float = 0.0  #: nominal optical density of the ND filter that is to be in; 0 for none
    settings: Settings = field(default_factory=Settings)
    settle: Settle = field(default_factory=Settle)
    seed: int = 0  #: seed of a simulated recording, from the protocol's seed and the point
    ambient: Ambient = "open"
    preamble: Preamble | None = None
    operator_before: str | None = None  #: what the operator is asked to do before this point
