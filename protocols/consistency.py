"""What the keys of a protocol must be together; what each must be by itself is in the schema."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from protocols.axes import numbers
from protocols.contrasts import PlanProblem
from protocols.expansion import measurement_points
from protocols.stimuli import ConstantStimulus, ResetTestStimulus, SquareStimulus

if TYPE_CHECKING:
    from collections.abc import Iterator

    from protocols.base import PathProblem
    from protocols.schema import Measurement, Protocol

__all__ = ["MOST_POINTS", "problems_of"]

MOST_POINTS = 100_000  #: in one protocol; a year of points of five minutes each


def problems_of(protocol: Protocol) -> list[PathProblem]:
    """Return everything that keeps `protocol` from being expanded, with paths below the protocol."""
    found = list(_repeated_names(protocol))
    for i, measurement in enumerate(protocol.measurements):
        found += [(("measurements", i, *path), text) for path, text in _measurement(protocol, measurement)]
    if not found:
        found += _too_many(protocol)
    if not found:
        found += _not_expandable(protocol)
    return found


def _repeated_names(protocol: Protocol) -> Iterator[PathProblem]:
    names = [m.name for m in protocol.measurements]
    for i, name in enumerate(names):
        if name in names[:i]:
            yield ("measurements", i, "name"), f"the name {name!r} is given twice"


def _measurement(protocol: Protocol, measurement: Measurement) -> Iterator[PathProblem]:
    if isinstance(measurement.stimulus, ConstantStimulus):
        yield from _constant(measurement)
        return
    yield from _pulsed(protocol, measurement)
    if isinstance(measurement.stimulus, SquareStimulus):
        yield from _square(measurement, measurement.stimulus)
    else:
        yield from _reset_test(measurement, measurement.stimulus)


def _constant(measurement: Measurement) -> Iterator[PathProblem]:
    for key in ("contrast", "polarity", "pulse_width_s"):
        if getattr(measurement.sweep, key) is not None:
            yield ("sweep", key), "constant light has no pulses"
    if measurement.pulses is not None:
        yield ("pulses",), "constant light has no pulses"


def _pulsed(protocol: Protocol, measurement: Measurement) -> Iterator[PathProblem]:
    if measurement.sweep.contrast is None:
        yield ("sweep",), "key 'contrast' is missing"
    if measurement.pulses is None and protocol.pulses is None:
        yield (), "key 'pulses' is missing, here and in the protocol"
    if min(numbers(measurement.sweep.illuminance_lux)) <= 0:
        yield ("sweep", "illuminance_lux"), "must be above 0 where there is a contrast"


def _square(measurement: Measurement, stimulus: SquareStimulus) -> Iterator[PathProblem]:
    if measurement.sweep.polarity is not None:
        yield ("sweep", "polarity"), "a square wave always shows both polarities"
    refine = None if measurement.sweep.contrast is None else measurement.sweep.contrast.refine
    if refine is not None and refine.until.theta_se is not None:
        where = ("sweep", "contrast", "refine", "until", "theta_se")
        yield where, "a square wave does not tell the threshold of a noisy pixel; ask for half_se or gap"
    yield from _one_of(stimulus.frequency_hz, "frequency_hz", measurement.sweep.pulse_width_s, "pulse_width_s")


def _reset_test(measurement: Measurement, stimulus: ResetTestStimulus) -> Iterator[PathProblem]:
    sweep = measurement.sweep
    yield from _one_of(stimulus.polarity, "polarity", sweep.polarity, "polarity")
    yield from _one_of(stimulus.test_s, "test_s", sweep.pulse_width_s, "pulse_width_s")
    widths = numbers(sweep.pulse_width_s) if sweep.pulse_width_s is not None else (stimulus.test_s or 0.0,)
    longest = min(widths) + stimulus.gap_s
    if stimulus.window_s is not None and stimulus.window_s > longest:
        yield (
            ("stimulus", "window_s"),
            f"{stimulus.window_s:g} s reaches into the next reset pulse, which begins {longest:g} s after the "
            "leading edge of the test pulse",
        )


def _one_of(fixed: object, fixed_key: str, swept: object, swept_key: str) -> Iterator[PathProblem]:
    """Require a quantity either in the stimulus or in the sweep."""
    if fixed is None and swept is None:
        yield ("stimulus",), f"key {fixed_key!r} is missing, and no {swept_key!r} is swept"
    if fixed is not None and swept is not None:
        yield ("sweep", swept_key), f"is swept, so {fixed_key!r} of the stimulus must be left out"


def _too_many(protocol: Protocol) -> Iterator[PathProblem]:
    total = sum(_count(m) for m in protocol.measurements)
    if total > MOST_POINTS:
        yield ("measurements",), f"these are {total} points, at most {MOST_POINTS} are allowed"


def _count(measurement: Measurement) -> int:
    sweep = measurement.sweep
    axes = (sweep.illuminance_lux, sweep.pulse_width_s, sweep.refractory_period_s, sweep.bandwidth_hz)
    lengths = [len(numbers(axis)) for axis in axes if axis is not None]
    lengths += [len(axis) for axis in (sweep.polarity, sweep.roi, sweep.thresholds) if axis]
    lengths += [len(offsets) for offsets in sweep.biases.values()]
    if isinstance(sweep.nd_od, tuple):
        lengths.append(len(sweep.nd_od))
    if sweep.contrast is not None:
        refine = sweep.contrast.refine
        lengths.append(len(sweep.contrast.numbers()) + (refine.at_most if refine is not None else 0))
    return math.prod(lengths)


def _not_expandable(protocol: Protocol) -> Iterator[PathProblem]:
    for i, measurement in enumerate(protocol.measurements):
        try:
            for _ in measurement_points(protocol, measurement):
                pass
        except PlanProblem as problem:
            yield ("measurements", i, *problem.path), problem.message
