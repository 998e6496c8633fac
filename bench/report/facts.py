"""What was measured, in a few lines: sensor, window, and what the points have in common."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bench.report.wording import capital, count, duration_label, lux_label, polarity_label, waveform_label
from bench.version import version

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.report.example import RunLike
    from bench.store.data import PointData, RunHeader

__all__ = ["Fact", "Facts", "facts_of", "software_of"]


@dataclass(frozen=True, slots=True)
class Fact:
    """A name and what it is."""

    name: str
    value: str


@dataclass(frozen=True, slots=True)
class _Summary:
    """What is kept of a point; the point itself may hold long arrays."""

    waveform: Any
    polarities: tuple[str, ...]
    lux: float
    log_contrasts: tuple[float, ...]
    pulses: int
    duration_s: float
    nd_od: float
    temperature_c: float
    refractory_s: float
    bias: tuple[tuple[str, float], ...]
    n_events: int
    masked: int
    gaps: int


@dataclass(frozen=True, slots=True)
class Facts:
    """The lines at the head of the report."""

    facts: tuple[Fact, ...]
    points: int


def facts_of(run: RunLike) -> Facts:
    """Return what the header and the points of `run` say.

    Of the station and the protocol only name, seed and settings are shown; nothing is computed from them.
    """
    points = [_summary(point) for point in run.points()]
    facts = [*_header_facts(run.header), *_stimulus_facts(points), *_recording_facts(points)]
    return Facts(tuple(facts), len(points))


def _summary(point: PointData) -> _Summary:
    kinds = set(point.pulse_kind.tolist())
    return _Summary(
        waveform=point.waveform,
        polarities=tuple(name for kind, name in ((0, "on"), (1, "off")) if kind in kinds),
        lux=point.baseline_lux,
        log_contrasts=tuple(sorted(set(point.pulse_log_contrast.round(9).tolist()))),
        pulses=int(point.pulse_start_s.size),
        duration_s=point.duration_s,
        nd_od=point.nd_od,
        temperature_c=point.temperature_c,
        refractory_s=point.refractory_s,
        bias=tuple(sorted(point.bias.items())),
        n_events=point.n_events,
        masked=len(point.masked),
        gaps=len(point.gaps_s),
    )


def _header_facts(header: RunHeader) -> list[Fact]:
    sensor, roi = header.sensor, header.roi
    optics = [f"{sensor.width} \u00d7 {sensor.height} pixels"]
    if math.isfinite(sensor.pixel_pitch_m):
        optics.append(f"pitch {sensor.pixel_pitch_m * 1e6:.3g} \u00b5m")
    if math.isfinite(sensor.quantum_efficiency):
        optics.append(f"quantum efficiency {sensor.quantum_efficiency:.3g}")
    window = f"{roi.width} \u00d7 {roi.height} pixels, from x = {roi.x}, y = {roi.y}"
    facts = [Fact("Sensor", f"{sensor.name}: {', '.join(optics)}"), Fact("Window", window)]
    if header.created:
        facts.append(Fact("Taken", header.created))
    return [*facts, *_asked(header)]


def _asked(header: RunHeader) -> list[Fact]:
    """Return on which station the run was taken and what the sensor was asked to be, as far as the header says."""
    station, protocol = header.everything.get("station"), header.everything.get("protocol")
    facts = []
    if isinstance(station, dict) and isinstance(station.get("name"), str):
        seed = header.everything.get("seed")
        facts.append(Fact("Station", station["name"] + (f", seed {seed}" if isinstance(seed, int) else "")))
    names: dict[str, list[str]] = {}
    for measurement in protocol.get("measurements", ()) if isinstance(protocol, dict) else ():
        settings = measurement.get("settings") if isinstance(measurement, dict) else None
        if isinstance(settings, dict) and (asked := ", ".join(_numbers(settings))):
            names.setdefault(asked, []).append(str(measurement.get("name", "unnamed")))
    for asked, those in names.items():
        facts.append(Fact("Settings asked", asked if len(names) == 1 else f"{', '.join(those)}: {asked}"))
    return facts


def _numbers(settings: dict[str, Any], prefix: str = "", unit: str = "") -> list[str]:
    """Return the numbers in nested settings as words: ``thresholds ON 0.3 ln, refractory period 10 ms``."""
    told = []
    for key, value in settings.items():
        stem, _, suffix = str(key).rpartition("_")
        if isinstance(value, dict):
            told += _numbers(value, f"{_words(str(key))} ", " ln" if key == "thresholds" else "")
        elif not isinstance(value, int | float) or isinstance(value, bool):
            continue
        elif suffix == "s" and stem:
            told.append(f"{prefix}{_words(stem)} {duration_label(value)}")
        elif suffix == "hz" and stem:
            told.append(f"{prefix}{_words(stem)} {value:g} Hz")
        elif unit:
            told.append(f"{prefix}{_words(str(key)).upper()} {value:g}{unit}")
        else:
            told.append(f"{prefix}{key} {value:g}")
    return told


def _words(key: str) -> str:
    return key.replace("_", " ")


def _stimulus_facts(points: Sequence[_Summary]) -> list[Fact]:
    groups: dict[tuple[Any, tuple[str, ...]], list[_Summary]] = {}
    for point in points:
        groups.setdefault((point.waveform, point.polarities), []).append(point)
    return [
        Fact(", ".join(filter(None, (capital(waveform_label(waveform)), _both(polarities)))), _stimulus(members))
        for (waveform, polarities), members in groups.items()
    ]


def _both(polarities: tuple[str, ...]) -> str:
    return " and ".join(polarity_label(polarity) for polarity in polarities)


def _stimulus(points: Sequence[_Summary]) -> str:
    parts = [count(len(points), "point")]
    parts.append(_range(sorted({p.lux for p in points}), "light level", lux_label))
    contrasts = sorted({c for p in points for c in p.log_contrasts})
    if contrasts:
        parts.append(_range(contrasts, "log contrast", lambda value: f"{value:.3g}"))
        parts.append(_from_to(sorted({p.pulses for p in points}), lambda n: f"{n}") + " test pulses each")
    else:
        parts.append(_from_to(sorted({p.duration_s for p in points}), duration_label) + " each")
    return ", ".join(parts)


def _range(values: Sequence[float], noun: str, label: Any) -> str:
    if len(values) == 1:
        return f"{noun} {label(values[0])}"
    return f"{count(len(values), noun)} from {label(values[0])} to {label(values[-1])}"


def _from_to(values: Sequence[Any], label: Any) -> str:
    return str(label(values[0])) if len(values) == 1 else f"{label(values[0])} to {label(values[-1])}"


def _recording_facts(points: Sequence[_Summary]) -> list[Fact]:
    if not points:
        return [Fact("Points", "none finished")]
    total_s = math.fsum(point.duration_s for point in points)
    events = sum(point.n_events for point in points)
    facts = [Fact("Recorded", f"{count(len(points), 'point')}, {_long(total_s)} of data, {count(events, 'event')}")]
    filters = sorted({point.nd_od for point in points})
    if filters != [0.0]:
        facts.append(Fact("ND filters", ", ".join(f"OD {od:g}" if od else "none" for od in filters)))
    warm = sorted({p.temperature_c for p in points if math.isfinite(p.temperature_c)})
    if warm:
        facts.append(Fact("Sensor temperature", _from_to([warm[0], warm[-1]] if len(warm) > 1 else warm, _celsius)))
    dead = sorted({p.refractory_s for p in points if math.isfinite(p.refractory_s)})
    if dead:
        facts.append(Fact("Dead time", _from_to([dead[0], dead[-1]] if len(dead) > 1 else dead, duration_label)))
    facts += _bias_facts(points)
    masked, gaps = max(p.masked for p in points), sum(p.gaps for p in points)
    if masked:
        facts.append(Fact("Masked", f"{count(masked, 'pixel')} switched off"))
    if gaps:
        facts.append(Fact("Gaps", f"{count(gaps, 'stretch', 'stretches')} without data"))
    return facts


def _bias_facts(points: Sequence[_Summary]) -> list[Fact]:
    """Return each bias that was read back, with its range over the run."""
    values: dict[str, set[float]] = {}
    for point in points:
        for name, value in point.bias:
            values.setdefault(name, set()).add(value)
    told = [f"{name} {_from_to([*sorted({min(v), max(v)})], lambda x: f'{x:g}')}" for name, v in values.items()]
    return [Fact("Biases, read back", ", ".join(told))] if told else []


def _celsius(value: float) -> str:
    return f"{value:.1f} \u00b0C"


def _long(seconds: float) -> str:
    if seconds < 120.0:
        return duration_label(seconds)
    return f"{seconds / 60.0:.1f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


def software_of(header: RunHeader) -> tuple[Fact, ...]:
    """Return the versions that took the run, as its header has them, and those that made the report."""
    import matplotlib as mpl
    import numpy as np

    taken = ", ".join(f"{name} {value}" for name, value in _flat(header.everything.get("software")))
    here = f"evs-bench {version()}, numpy {np.__version__}, matplotlib {mpl.__version__}"
    return (*([Fact("Recorded with", taken)] if taken else []), Fact("Report made with", here))


def _flat(value: Any, prefix: str = "") -> list[tuple[str, str]]:
    """Return a nested mapping as pairs of a dotted name and a text."""
    if isinstance(value, dict):
        return [
            pair for key, item in value.items() for pair in _flat(item, f"{prefix}.{key}" if prefix else str(key))
        ]
    return [] if value is None else [(prefix or "software", str(value))]
