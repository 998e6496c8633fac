"""The stimulus of an imported point: given by its edges, or made from a few numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from protocols.stimulus import Stimulus
from protocols.waveforms import STEP_DOWN, STEP_UP, constant_light, reset_test_edges, square_edges

if TYPE_CHECKING:
    from bench.importing.schema import PointSection, ResetTestSection, SquareSection

__all__ = ["Light", "light_of"]


@dataclass(frozen=True, slots=True)
class Light:
    """The light of an imported point, and the numbers that follow from it."""

    stimulus: Stimulus  #: on its own time axis; it lasts as long as it is known
    baseline_lux: float
    log_contrast: float
    reset_log_contrast: float | None


def light_of(section: PointSection) -> Light:
    """Return the light that `section` describes."""
    if section.square is not None:
        return _square(section.square)
    if section.reset_test is not None:
        return _reset_test(section.reset_test)
    if section.constant is not None:
        lux = section.constant.illuminance_lux
        return Light(constant_light(lux, 0.0), lux, 0.0, None)
    return _edges(section)


def _square(section: SquareSection) -> Light:
    stimulus = square_edges(**section.model_dump())
    return Light(stimulus, section.low_lux, math.log(section.high_lux / section.low_lux), None)


def _reset_test(section: ResetTestSection) -> Light:
    stimulus = reset_test_edges(**section.model_dump())
    test, reset = (abs(math.log(lux / section.baseline_lux)) for lux in (section.test_lux, section.reset_lux))
    return Light(stimulus, section.baseline_lux, test, reset)


def _edges(section: PointSection) -> Light:
    t_s, lux = np.array(section.edges, np.float64).T.copy()
    pulses = sorted(section.pulses or (), key=lambda pulse: pulse.start_s)
    stimulus = Stimulus(
        t_s=t_s,
        lux=lux,
        duration_s=max([float(t_s[-1]), *(p.stop_s for p in pulses)]),
        pulse_start_s=np.array([p.start_s for p in pulses], np.float64),
        pulse_stop_s=np.array([p.stop_s for p in pulses], np.float64),
        pulse_kind=np.array([STEP_UP if p.direction == "up" else STEP_DOWN for p in pulses], np.uint8),
    )
    baseline_lux = float(lux[0]) if section.baseline_lux is None else section.baseline_lux
    return Light(stimulus, baseline_lux, section.log_contrast or 0.0, section.reset_log_contrast)
