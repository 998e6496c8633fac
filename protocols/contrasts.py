"""From the contrasts of a file, in their scale, to natural log contrasts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

from protocols.expected import off_impossible_at_lux, off_log_contrast, on_log_contrast, rearm_log_contrast
from protocols.stimuli import SquareStimulus

if TYPE_CHECKING:
    from protocols.axes import ContrastScale
    from protocols.expansion import Condition
    from protocols.expected import Expected
    from protocols.schema import Measurement, Protocol
    from protocols.stimuli import ResetContrast

__all__ = ["HIGHEST_LOG_CONTRAST", "PlanProblem", "log_contrasts", "reset_log_contrast"]

HIGHEST_LOG_CONTRAST = 15.0  #: a factor of three million, beyond any light source


class PlanProblem(Exception):
    """A measurement that cannot be expanded: the path below the measurement, and what is wrong there."""

    def __init__(self, path: tuple[str | int, ...], message: str) -> None:
        self.path = path
        self.message = message
        super().__init__(f"{'.'.join(map(str, path))}: {message}")


def log_contrasts(protocol: Protocol, measurement: Measurement, condition: Condition) -> list[float]:
    """Return the log contrasts of the test pulses at `condition`; [0] for constant light."""
    contrast = measurement.sweep.contrast
    if contrast is None:
        return [0.0]
    path = ("sweep", "contrast")
    unit = 1.0
    if contrast.scale == "threshold":
        square = isinstance(measurement.stimulus, SquareStimulus)
        unit = _test_unit(protocol.believed().under(condition.settings), condition, square, path)
    return [_in_range(_to_log(contrast.scale, value, unit), path) for value in contrast.numbers()]


def reset_log_contrast(
    protocol: Protocol, reset: ResetContrast, condition: Condition, direction: Literal["up", "down"]
) -> float:
    """Return the log contrast of the reset pulse at `condition`."""
    path = ("stimulus", "reset_contrast")
    value = reset.at(condition.lux)
    if value is None:
        raise PlanProblem((*path, "by_level"), f"there is no contrast for {condition.lux:g} lux")
    unit = 1.0
    if reset.scale == "threshold":
        expected = protocol.believed().under(condition.settings)
        unit = _reset_unit(expected, condition, direction, path)
    return _in_range(_to_log(reset.scale, value, unit), path)


def _to_log(scale: ContrastScale, value: float, unit: float) -> float:
    """Return the natural log contrast; linear contrast c is E_max / E_min = 1 + c."""
    return math.log1p(value) if scale == "linear" else value * unit


def _in_range(log_contrast: float, path: tuple[str, ...]) -> float:
    if log_contrast > HIGHEST_LOG_CONTRAST:
        raise PlanProblem(
            path, f"a log contrast of {log_contrast:g} is out of range, must be at most {HIGHEST_LOG_CONTRAST:g}"
        )
    return log_contrast


def _test_unit(expected: Expected, condition: Condition, square: bool, path: tuple[str, ...]) -> float:
    """Return the log contrast at which a noise-free pixel answers the test pulse.

    Both steps of a square wave go between the same two levels, so that each changes the log photocurrent alike,
    and the less sensitive threshold decides when both are crossed.
    """
    dark = _known(expected.dark_light_lux, "dark_light_lux", path)
    if square:
        theta_on = _known(expected.theta_on, "theta_on", path)
        theta_off = _known(expected.theta_off, "theta_off", path)
        return on_log_contrast(condition.lux, max(theta_on, theta_off), dark)
    if condition.polarity == "on":
        return on_log_contrast(condition.lux, _known(expected.theta_on, "theta_on", path), dark)
    theta_off = _known(expected.theta_off, "theta_off", path)
    unit = off_log_contrast(condition.lux, theta_off, dark)
    return _possible(unit, "OFF", condition.lux, theta_off, dark, path)


def _reset_unit(
    expected: Expected, condition: Condition, direction: Literal["up", "down"], path: tuple[str, ...]
) -> float:
    """Return the log contrast at which the return of the reset pulse just re-arms a noise-free pixel."""
    dark = _known(expected.dark_light_lux, "dark_light_lux", path)
    theta_on = _known(expected.theta_on, "theta_on", path)
    theta_off = _known(expected.theta_off, "theta_off", path)
    unit = rearm_log_contrast(direction, condition.lux, theta_on, theta_off, dark)
    return _possible(unit, "ON", condition.lux, theta_on, dark, path)


def _known(value: float | None, name: str, path: tuple[str, ...]) -> float:
    if value is None:
        where = "expect" if name == "dark_light_lux" else "settings or expect"
        raise PlanProblem((*path, "scale"), f"the threshold scale needs {name}: give it under {where}")
    return value


def _possible(
    unit: float, event: str, lux: float, theta: float, dark_light_lux: float, path: tuple[str, ...]
) -> float:
    if math.isinf(unit):
        lowest = off_impossible_at_lux(theta, dark_light_lux)
        raise PlanProblem(
            path,
            f"from {lux:g} lux even darkness and back is less than the {event} threshold of {theta:g}: with a dark "
            f"light of {dark_light_lux:g} lux the level must be above {lowest:.3g} lux",
        )
    return unit
