"""Which S-curves stand in one figure: those that differ in one thing only, most often the light level."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from bench.report.wording import duration_label, lux_label, waveform_label

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from bench.analysis.results import CurveKey

__all__ = ["Axis", "Family", "Step", "families_of"]

Axis = Literal["level", "width", "settings"]
AXES: tuple[Axis, ...] = ("level", "width", "settings")


@dataclass(frozen=True, slots=True)
class Step:
    """One colour of a family: a light level, a pulse width or a setting."""

    index: int  #: from 0, in the order of the axis: it picks colour and marker
    value: float  #: lux or s; the index for settings
    label: str


@dataclass(frozen=True, slots=True)
class Family:
    """Keys that differ in polarity and in one axis."""

    name: str  #: for file names: empty where a run has one family only
    title: str  #: what its curves have in common, for people
    axis: Axis
    steps: tuple[Step, ...]
    places: dict[tuple[float | str, ...], int]  #: value of the axis -> index of its step
    common: tuple[object, ...]

    def step_of(self, key: CurveKey) -> Step | None:
        """Return the step to which `key` belongs, or None if it belongs to another family."""
        if _common(key, self.axis) != self.common:
            return None
        return self.steps[self.places[_on_axis(key, self.axis)]]


def _on_axis(key: CurveKey, axis: Axis) -> tuple[float | str, ...]:
    if axis == "level":
        return (key.baseline_lux, key.nd_od)
    return (key.pulse_width_s,) if axis == "width" else (key.settings,)


def _common(key: CurveKey, axis: Axis) -> tuple[object, ...]:
    rest = tuple(_on_axis(key, other) for other in AXES if other != axis)
    return (key.waveform, *rest)


def families_of(keys: Iterable[CurveKey]) -> tuple[Family, ...]:
    """Return the families of `keys`, split along every axis but the one with most values (of equals: light level)."""
    all_keys = list(dict.fromkeys(keys))
    if not all_keys:
        return ()
    axis = max(AXES, key=lambda a: len({_on_axis(key, a) for key in all_keys}))
    groups: dict[tuple[object, ...], list[CurveKey]] = {}
    for key in all_keys:
        groups.setdefault(_common(key, axis), []).append(key)
    several = len(groups) > 1
    return tuple(
        _family(members, axis, common, f"{number}" if several else "")
        for number, (common, members) in enumerate(groups.items(), start=1)
    )


def _family(members: Sequence[CurveKey], axis: Axis, common: tuple[object, ...], name: str) -> Family:
    values = sorted({_on_axis(key, axis) for key in members})
    steps = tuple(
        Step(index, value[0] if isinstance(value[0], float) else float(index), _step_label(value, axis, values))
        for index, value in enumerate(values)
    )
    places = {value: index for index, value in enumerate(values)}
    return Family(name, _title(members[0], axis), axis, steps, places, common)


def _step_label(value: tuple[float | str, ...], axis: Axis, values: Sequence[tuple[float | str, ...]]) -> str:
    first = value[0]
    if isinstance(first, str):
        return first or "as set"
    if axis == "width":
        return duration_label(first)
    twice = sum(other[0] == first for other in values) > 1
    return f"{lux_label(first)}, OD {value[1]:g}" if twice else lux_label(first)


def _title(key: CurveKey, axis: Axis) -> str:
    parts = [waveform_label(key.waveform)]
    if axis != "level":
        parts.append(lux_label(key.baseline_lux))
    if axis != "width":
        parts.append(f"pulses of {duration_label(key.pulse_width_s)}")
    if axis != "settings" and key.settings:
        parts.append(key.settings)
    return ", ".join(parts)
