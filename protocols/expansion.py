"""From a protocol to its points.

Order. Measurements are taken as they are written, except that within a block points are brought together first by
ND filter, and within one filter by settings and window, so that the wheel moves and the biases change as seldom as
possible. A block starts from the filter and the settings that are in, the others follow as first written. Points
never cross an operator's step or a change of the ambient light: a measurement with an operator's step is a block of
its own, and so is each run of measurements with the same ambient light. Within one filter and setting the order is:
illuminance, polarity, pulse width, contrast, each as written; `order: shuffled` permutes the contrasts by the seed.

Seeds. The seed of a point is a hash of the protocol's seed, the measurement's name and the number of the point
within the measurement as written. It does not depend on the order in which points are taken, nor on other
measurements, nor on the machine. For points that are added to a curve while it is taken
(:mod:`protocols.refining`) the number of the curve within the measurement and theirs within the curve take its place.
"""

from __future__ import annotations

import hashlib
import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

from protocols.axes import NdBelow, numbers
from protocols.contrasts import log_contrasts, reset_log_contrast
from protocols.points import (
    ConstantTiming,
    Point,
    Polarity,
    Preamble,
    ResetTestTiming,
    Roi,
    Settings,
    Settle,
    SquareTiming,
    Timing,
)
from protocols.settings import overlay
from protocols.stimuli import ConstantStimulus, ResetTestStimulus, SquareStimulus

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from protocols.axes import Sweep
    from protocols.schema import Measurement, Protocol

__all__ = [
    "Condition",
    "conditions",
    "expand",
    "in_order",
    "measurement_points",
    "seed_of",
    "settings_of",
    "settle_of",
]


@dataclass(frozen=True, slots=True)
class Condition:
    """Everything of a point but its contrast."""

    settings: Settings
    roi: Roi
    nd_od: float
    lux: float
    polarity: Polarity
    width_s: float | None  #: length of the test pulse where it is swept, s


def expand(protocol: Protocol) -> tuple[Point, ...]:
    """Return the numbered points of `protocol`, in the order in which they are taken.

    Parameters
    ----------
    protocol
        A protocol that was read or made; one that validates expands without errors.

    Returns
    -------
    tuple of Point
        `index` counts from 0. `operator_before` stands on the first point of its measurement.
    """
    return tuple(replace(point, index=i) for i, point in enumerate(in_order(protocol)))


def in_order(protocol: Protocol) -> list[Point]:
    """Return the points of `protocol` in the order in which they are taken; `index` counts within the measurement."""
    points: list[Point] = []
    last = _State(nd_od=0.0, setting=None)
    for block in _blocks(protocol):
        taken, last = _sparing_changes(block, last)
        points += _with_operator_steps(protocol, taken)
    return points


def measurement_points(protocol: Protocol, measurement: Measurement) -> Iterator[Point]:
    """Yield the points of one measurement, as written; `index` counts within the measurement."""
    ordinal = itertools.count()
    for condition in conditions(protocol, measurement):
        points = [
            _point(protocol, measurement, condition, log_contrast, next(ordinal))
            for log_contrast in log_contrasts(protocol, measurement, condition)
        ]
        # A point's seed is a hash, so sorting by it is a permutation drawn from the protocol's seed.
        yield from sorted(points, key=lambda p: p.seed) if protocol.order == "shuffled" else points


def conditions(protocol: Protocol, measurement: Measurement) -> Iterator[Condition]:
    """Yield every combination of the axes but the contrast, the last of the axes changing fastest."""
    sweep = measurement.sweep
    settings = _settings_axis(settings_of(protocol, measurement), sweep)
    rois = [roi.to_roi() for roi in sweep.roi or (measurement.roi or protocol.roi,)]
    filters = sweep.nd_od if isinstance(sweep.nd_od, tuple) else (sweep.nd_od,)
    widths = (None,) if sweep.pulse_width_s is None else numbers(sweep.pulse_width_s)
    axes = (filters, settings, rois, numbers(sweep.illuminance_lux), _polarities(measurement), widths)
    for nd, setting, roi, lux, polarity, width_s in itertools.product(*axes):
        yield Condition(setting, roi, _nd_od(nd, lux), lux, polarity, width_s)


def settings_of(protocol: Protocol, measurement: Measurement) -> Settings:
    """Return the settings of a measurement before its sweep."""
    own = measurement.settings
    common = protocol.settings.to_settings()
    return overlay(common, own.to_settings()) if own else common


def settle_of(protocol: Protocol, measurement: Measurement) -> Settle:
    """Return the settling times of a measurement."""
    common = protocol.settle.over(Settle())
    return measurement.settle.over(common) if measurement.settle else common


def _settings_axis(base: Settings, sweep: Sweep) -> list[Settings]:
    """Return the settings of every combination of the axes that change them."""
    changes: list[list[dict[str, Any]]] = [
        [{"theta_on": pair.on, "theta_off": pair.off} for pair in sweep.thresholds or ()],
        [{"refractory_s": v} for v in _axis(sweep.refractory_period_s)],
        [{"bandwidth_hz": v} for v in _axis(sweep.bandwidth_hz)],
    ]
    changes += [[{"biases": ((name, v),)} for v in offsets] for name, offsets in sweep.biases.items()]
    found = [base]
    for axis in changes:
        if axis:
            found = [overlay(settings, Settings(**change)) for settings in found for change in axis]
    return found


def _axis(axis: Any) -> tuple[float, ...]:
    return () if axis is None else numbers(axis)


def _polarities(measurement: Measurement) -> tuple[Polarity, ...]:
    stimulus = measurement.stimulus
    if not isinstance(stimulus, ResetTestStimulus):
        return ("both",)
    if measurement.sweep.polarity:
        return measurement.sweep.polarity
    return (stimulus.polarity,) if stimulus.polarity else ()


def _nd_od(nd: float | NdBelow, lux: float) -> float:
    if isinstance(nd, NdBelow):
        return nd.od if lux < nd.below_lux else 0.0
    return nd


def _point(
    protocol: Protocol, measurement: Measurement, condition: Condition, log_contrast: float, ordinal: int
) -> Point:
    constant = isinstance(measurement.stimulus, ConstantStimulus)
    return Point(
        index=ordinal,
        measurement=measurement.name,
        waveform=measurement.stimulus.kind,
        polarity=condition.polarity,
        baseline_lux=condition.lux,
        log_contrast=log_contrast,
        pulses=0 if constant else measurement.pulses or protocol.pulses or 0,
        timing=_timing(protocol, measurement, condition),
        roi=condition.roi,
        nd_od=condition.nd_od,
        settings=condition.settings,
        settle=settle_of(protocol, measurement),
        seed=seed_of(protocol, measurement, ordinal),
        ambient=measurement.ambient,
        preamble=_preamble(measurement),
    )


def _preamble(measurement: Measurement) -> Preamble | None:
    stimulus = measurement.stimulus
    if isinstance(stimulus, ConstantStimulus) or stimulus.preamble is None:
        return None
    return stimulus.preamble.to_preamble()


def seed_of(protocol: Protocol, measurement: Measurement, which: int | str) -> int:
    """Return the seed of the point `which` of a measurement: 63 bits, so that it fits a signed 64-bit attribute."""
    seed = protocol.seed if measurement.seed is None else measurement.seed
    digest = hashlib.sha256(f"{seed}/{measurement.name}/{which}".encode()).digest()
    return int.from_bytes(digest[:8], "big") >> 1


def _timing(protocol: Protocol, measurement: Measurement, condition: Condition) -> Timing:
    stimulus = measurement.stimulus
    if isinstance(stimulus, ConstantStimulus):
        return ConstantTiming(stimulus.duration_s)
    if isinstance(stimulus, SquareStimulus):
        return _square_timing(stimulus, condition.width_s)
    return _reset_test_timing(protocol, stimulus, condition)


def _square_timing(stimulus: SquareStimulus, width_s: float | None) -> SquareTiming:
    """Return the timing; a swept pulse width is the bright part, and the duty gives the period."""
    frequency_hz = stimulus.frequency_hz if width_s is None else stimulus.duty / width_s
    if frequency_hz is None:
        raise ValueError("a square wave without frequency and without pulse width")
    return SquareTiming(frequency_hz, stimulus.duty)


def _reset_test_timing(protocol: Protocol, stimulus: ResetTestStimulus, condition: Condition) -> ResetTestTiming:
    test_s = stimulus.test_s if condition.width_s is None else condition.width_s
    if test_s is None:
        raise ValueError("a reset/test stimulus without test length and without pulse width")
    direction = _reset_direction(stimulus, condition.polarity)
    return ResetTestTiming(
        gap_s=stimulus.gap_s,
        reset_s=stimulus.reset_s,
        reset_log_contrast=reset_log_contrast(protocol, stimulus.reset_contrast, condition, direction),
        reset_direction=direction,
        test_s=test_s,
        window_s=test_s if stimulus.window_s is None else stimulus.window_s,
    )


def _reset_direction(stimulus: ResetTestStimulus, polarity: Polarity) -> Literal["up", "down"]:
    return "up" if (polarity == "on") == (stimulus.reset_direction == "same") else "down"


@dataclass(frozen=True, slots=True)
class _State:
    """What the bench is left at by a point."""

    nd_od: float
    setting: tuple[Settings, Roi] | None


def _blocks(protocol: Protocol) -> Iterator[list[Point]]:
    """Yield the points in runs across which nothing may be moved."""
    block: list[Point] = []
    previous: Measurement | None = None
    for measurement in protocol.measurements:
        if previous is not None and _must_not_mix(previous, measurement):
            yield block
            block = []
        block += measurement_points(protocol, measurement)
        previous = measurement
    yield block


def _must_not_mix(first: Measurement, second: Measurement) -> bool:
    return bool(first.operator or second.operator) or first.ambient != second.ambient


def _setting(point: Point) -> tuple[Settings, Roi]:
    return point.settings, point.roi


def _sparing_changes(points: list[Point], last: _State) -> tuple[list[Point], _State]:
    """Bring points of one filter together, and within it those of one setting, starting from what is in."""
    taken: list[Point] = []
    for same_filter in _groups(points, lambda p: p.nd_od, last.nd_od):
        for same_setting in _groups(same_filter, _setting, last.setting):
            taken += same_setting
            last = _State(same_setting[-1].nd_od, _setting(same_setting[-1]))
    return taken, last


def _groups(points: Iterable[Point], key: Callable[[Point], Any], current: Any) -> list[list[Point]]:
    """Group by `key`: first the group of `current`, then the others as they first appear."""
    groups: dict[Any, list[Point]] = {current: []}
    for point in points:
        groups.setdefault(key(point), []).append(point)
    return [group for group in groups.values() if group]


def _with_operator_steps(protocol: Protocol, points: list[Point]) -> list[Point]:
    """Put each operator's step on the first point of its measurement."""
    steps = {m.name: m.operator.before for m in protocol.measurements if m.operator}
    return [replace(p, operator_before=steps.pop(p.measurement, None)) for p in points]
