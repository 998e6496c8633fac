"""A protocol with nothing left to defaults."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from protocols.axes import numbers
from protocols.expansion import settings_of, settle_of
from protocols.stimuli import ConstantStimulus, ResetTestStimulus

if TYPE_CHECKING:
    from protocols.points import Settings
    from protocols.schema import Measurement, Protocol

__all__ = ["resolved"]


def resolved(protocol: Protocol) -> dict[str, Any]:
    """Return `protocol` as plain data in which every measurement stands by itself.

    Defaults and what a measurement takes from the protocol are written out, axes are lists of numbers, settings have
    their plain names. None stands for what is left to the camera. The result validates as a protocol, and expands
    into the same points.
    """
    top = protocol.model_dump(mode="json", exclude={"measurements", "settings", "settle", "pulses"})
    return top | {"measurements": [_measurement(protocol, m) for m in protocol.measurements]}


def _measurement(protocol: Protocol, measurement: Measurement) -> dict[str, Any]:
    constant = isinstance(measurement.stimulus, ConstantStimulus)
    return {
        "name": measurement.name,
        "ambient": measurement.ambient,
        "operator": measurement.operator.model_dump() if measurement.operator else None,
        "stimulus": _stimulus(measurement),
        "pulses": None if constant else measurement.pulses or protocol.pulses,
        "roi": (measurement.roi or protocol.roi).model_dump(),
        "seed": protocol.seed if measurement.seed is None else measurement.seed,
        "settings": _settings(settings_of(protocol, measurement)),
        "settle": asdict(settle_of(protocol, measurement)),
        "sweep": _sweep(measurement),
    }


def _stimulus(measurement: Measurement) -> dict[str, Any]:
    stimulus = measurement.stimulus
    written = stimulus.model_dump(mode="json")
    if isinstance(stimulus, ResetTestStimulus) and stimulus.window_s is None:
        written["window_s"] = stimulus.test_s
    return written


def _settings(settings: Settings) -> dict[str, Any]:
    known = settings.theta_on is not None and settings.theta_off is not None
    return {
        "thresholds": {"on": settings.theta_on, "off": settings.theta_off} if known else None,
        "refractory_period_s": settings.refractory_s,
        "bandwidth_hz": settings.bandwidth_hz,
        "biases": dict(settings.biases),
    }


def _sweep(measurement: Measurement) -> dict[str, Any]:
    sweep = measurement.sweep
    written = sweep.model_dump(mode="json")
    for key in ("illuminance_lux", "pulse_width_s", "refractory_period_s", "bandwidth_hz"):
        axis = getattr(sweep, key)
        if axis is not None:
            written[key] = list(numbers(axis))
    if sweep.contrast is not None:
        refine = sweep.contrast.refine
        written["contrast"] = {
            "scale": sweep.contrast.scale,
            "values": list(sweep.contrast.numbers()),
            **({"refine": refine.model_dump(mode="json", exclude_none=True)} if refine is not None else {}),
        }
    return written
