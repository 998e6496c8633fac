"""The schema of ``recordings.yaml``: the keys of ``run.yaml``, and a list of points with their recordings."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from protocols.base import NAME_PATTERN, FrozenModel, Illuminance, Number, Seconds, WaitingTime, problems_at
from protocols.points import Ambient, Polarity, Waveform
from protocols.settings import RoiChoice

__all__ = ["PointSection", "PulseSection", "RecordingsFile", "ResetTestSection", "SensorSection", "SquareSection"]

Text = Annotated[str, Field(min_length=1)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Cycles = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]
Edge = tuple[WaitingTime, Illuminance]

_SAME_LEVEL = 1e-3  # a level or contrast that is told twice may differ by its rounding


class SensorSection(FrozenModel):
    """The sensor that recorded."""

    name: Text
    """What it is called."""
    width: Annotated[int, Field(strict=True, ge=1, le=65535)]
    """Columns."""
    height: Annotated[int, Field(strict=True, ge=1, le=65535)]
    """Rows."""
    pixel_pitch_m: Positive | None = None
    """Distance of two pixels, m; unknown if left out."""
    quantum_efficiency: Annotated[Number, Field(gt=0, le=1)] | None = None
    """Averaged over the spectrum of the light; unknown if left out."""
    photons_per_lux: Positive = 1.12e16
    """Per square metre and second."""


class SquareSection(FrozenModel):
    """A square wave that starts from its lower level."""

    period_s: Seconds
    """Length of a period, s."""
    duty: Annotated[Number, Field(gt=0, lt=1)]
    """Bright part of a period."""
    low_lux: Illuminance
    """Lower level, lux on chip."""
    high_lux: Illuminance
    """Upper level, lux on chip."""
    cycles: Cycles
    """Number of periods, each a bright part and the dark part that follows it."""
    first_edge_s: Seconds
    """When the light first goes up, s."""

    @model_validator(mode="after")
    def _goes_up(self) -> Self:
        if not 0.0 < self.low_lux < self.high_lux:
            raise problems_at([(("high_lux",), "must be above low_lux, and low_lux above 0")])
        return self


class ResetTestSection(FrozenModel):
    """Pairs of a reset pulse and a test pulse."""

    baseline_lux: Positive
    """Level between the pulses, lux on chip."""
    reset_lux: Positive
    """Level of the reset pulse, lux on chip."""
    test_lux: Positive
    """Level of the test pulse, lux on chip."""
    gap_s: Seconds
    """Baseline before each pulse, s."""
    reset_s: Seconds
    """Length of the reset pulse, s."""
    test_s: Seconds
    """Length of the test pulse, s."""
    cycles: Cycles
    """Number of pairs."""
    window_s: Seconds | None = None
    """Response window from the leading edge of the test pulse, s; as long as the test pulse if left out."""
    first_edge_s: Seconds
    """When the first reset pulse begins, s."""

    @model_validator(mode="after")
    def _has_steps(self) -> Self:
        found = [
            ((key,), "equals baseline_lux")
            for key in ("reset_lux", "test_lux")
            if getattr(self, key) == self.baseline_lux
        ]
        if found:
            raise problems_at(found)
        return self


class ConstantSection(FrozenModel):
    """One level."""

    illuminance_lux: Illuminance
    """Lux on chip."""


class PulseSection(FrozenModel):
    """The response window of one test pulse."""

    start_s: WaitingTime
    """Leading edge, s."""
    stop_s: Seconds
    """End of the window, s."""
    direction: Literal["up", "down"]
    """up: a step up, an ON event is expected."""

    @model_validator(mode="after")
    def _ends_later(self) -> Self:
        if self.stop_s <= self.start_s:
            raise problems_at([(("stop_s",), "must be later than start_s")])
        return self


class PointSection(FrozenModel):
    """One recording, and how it was taken."""

    file: Text
    """The recording, relative to the folder: RAW, EVT3, EVT2.1, EVT2, DAT, or a point file (HDF5) of a run."""
    format: Text | None = None
    """What the recording is, where neither its header nor its extension says so."""
    waveform: Waveform
    """square, reset_test or constant."""
    polarity: Polarity
    """Which response is under test; both for a constant point."""
    nd_od: NotNegative
    """Optical density of the ND filter; 0 for none."""
    baseline_lux: Illuminance | None = None
    """Level from which the test pulse steps, lux on chip; follows from a generator."""
    log_contrast: NotNegative | None = None
    """ln(E_max / E_min) of the test pulse; follows from a generator."""
    refractory_s: Positive | None = None
    """Dead time that the settings are believed to give, s."""
    temperature_c: Number | None = None
    """Temperature of the sensor, degrees Celsius."""
    edges: Annotated[tuple[Edge, ...], Field(min_length=1)] | None = None
    """The stimulus as pairs of time (s) and level (lux); the first is the level at the beginning, at time 0."""
    pulses: tuple[PulseSection, ...] | None = None
    """The response windows, where the stimulus is given by its edges."""
    square: SquareSection | None = None
    """The stimulus, as a square wave."""
    reset_test: ResetTestSection | None = None
    """The stimulus, as reset and test pulses."""
    constant: ConstantSection | None = None
    """The stimulus, as one level."""
    align: Literal["trigger", "edges_known", "from_events"] = "edges_known"
    """What tells when the stimulus began: its triggers, the times as they are written, or the events themselves."""
    roi: RoiChoice | None = None
    """The window of this recording, in place of that of the run."""
    start_us: Annotated[int, Field(strict=True, ge=0)] | None = None
    """Time stamp of the recording that becomes 0; that of its first event or trigger if left out."""
    time_window_s: tuple[WaitingTime, Seconds] | None = None
    """Begin and end (s after the start) of what is taken; its begin becomes 0. All if left out."""
    duration_s: Seconds | None = None
    """Length of the whole recording, s; what comes later is cut. Until its last event or trigger if left out."""
    trigger_channel: Annotated[int, Field(strict=True, ge=0, le=255)] | None = None
    """The trigger input that counts; all if left out."""
    bias: dict[str, Number] = Field(default_factory=dict)
    """Settings as read back, by name."""
    measurement: str | None = None
    """Name of the measurement."""
    started: str | None = None
    """When it began, UTC."""
    ambient: Ambient | None = None
    """Whether light from the room could reach the sensor."""
    nd_id: str | None = None
    """Which filter it was."""
    nd_transmission: Positive | None = None
    """Its transmission, as measured."""
    bench_lux_before: NotNegative | None = None
    """What a meter on the bench read before the recording, lux."""
    bench_lux_after: NotNegative | None = None
    """And after it, lux."""
    reset_log_contrast: Positive | None = None
    """ln(E_max / E_min) of the reset pulse; only beside `edges`."""

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        found = [problem for rule in (_stimulus_problem, _level_problem, _time_problem) if (problem := rule(self))]
        if found:
            raise problems_at(found)
        return self


def _stimulus_problem(point: PointSection) -> tuple[tuple[str, ...], str] | None:
    given = [name for name in ("edges", "square", "reset_test", "constant") if getattr(point, name) is not None]
    if len(given) != 1:
        return (), f"needs one of edges, square, reset_test and constant, found {' and '.join(given) or 'none'}"
    if given != ["edges"] and given != [point.waveform]:
        return ("waveform",), f"is {point.waveform}, but the stimulus is {given[0]}"
    if point.edges is not None:
        return _edges_problem(point, point.edges)
    return None if point.pulses is None else (("pulses",), f"follow from {given[0]}, leave them out")


def _edges_problem(point: PointSection, edges: tuple[Edge, ...]) -> tuple[tuple[str, ...], str] | None:
    times = [t for t, _ in edges]
    if times[0] != 0.0:
        return ("edges",), "must begin with the level at time 0"
    if any(after <= before for before, after in pairwise(times)):
        return ("edges",), "must be in the order of time, each later than the one before"
    if point.waveform != "constant" and point.pulses is None:
        return ("edges",), "need the response windows beside them: pulses: [{start_s, stop_s, direction}, ...]"
    return None


def _level_problem(point: PointSection) -> tuple[tuple[str, ...], str] | None:
    if point.edges is not None and point.waveform != "constant":
        known = point.baseline_lux and point.log_contrast
        return None if known else ((), "edges need baseline_lux and log_contrast beside them, both above 0")
    for name, given in _levels_of(point).items():
        told = getattr(point, name)
        if told is not None and not math.isclose(told, given, rel_tol=_SAME_LEVEL, abs_tol=_SAME_LEVEL):
            return (name,), f"is {told:g}, but the stimulus gives {given:g}"
    pulse = point.reset_test
    if pulse is not None and point.polarity != ("on" if pulse.test_lux > pulse.baseline_lux else "off"):
        return ("polarity",), "does not agree with the direction of the test pulse"
    return None


def _levels_of(point: PointSection) -> dict[str, float]:
    """Return the attributes that follow from the stimulus; a file may repeat them, as a point file does."""
    if point.square is not None:
        square = point.square
        return {"baseline_lux": square.low_lux, "log_contrast": math.log(square.high_lux / square.low_lux)}
    if point.reset_test is not None:
        pulse = point.reset_test
        contrast = abs(math.log(pulse.test_lux / pulse.baseline_lux))
        return {"baseline_lux": pulse.baseline_lux, "log_contrast": contrast}
    levels = {"log_contrast": 0.0}
    if point.constant is not None:
        levels["baseline_lux"] = point.constant.illuminance_lux
    elif point.edges is not None:
        levels["baseline_lux"] = point.edges[0][1]
    return levels


def _time_problem(point: PointSection) -> tuple[tuple[str, ...], str] | None:
    if point.time_window_s is not None and point.time_window_s[1] <= point.time_window_s[0]:
        return ("time_window_s",), "must end later than it begins"
    if point.time_window_s is not None and point.duration_s is not None and point.time_window_s[1] > point.duration_s:
        return ("time_window_s",), f"ends after the recording, whose duration_s is {point.duration_s:g}"
    if point.align != "edges_known" and point.waveform == "constant":
        return ("align",), "a constant point has no edges to align"
    return None


class RecordingsFile(FrozenModel):
    """Recordings that were made elsewhere, and how they were taken."""

    format: Literal["evs-bench-run/1"]
    """Name and version of the format of the run that is made."""
    id: Annotated[str, Field(pattern=NAME_PATTERN)] | None = None
    """Unique name of the run; made of the time and the title if left out."""
    created: str | None = None
    """When the recordings were made, UTC."""
    title: str = ""
    """One line: what was recorded."""
    sensor: SensorSection
    """The sensor."""
    roi: RoiChoice
    """The window of pixels."""
    protocol: dict[str, Any] | None = None
    """What was asked, in any form; kept."""
    protocol_text: str | None = None
    """The file in which it was asked; kept."""
    station: dict[str, Any] | None = None
    """What it was recorded on, in any form; kept."""
    software: dict[str, Any] | None = None
    """What recorded it, in any form; kept."""
    points: Annotated[tuple[PointSection, ...], Field(min_length=1)]
    """The recordings."""

    @model_validator(mode="after")
    def _windows_fit(self) -> Self:
        windows: list[tuple[tuple[str | int, ...], RoiChoice]] = [(("roi",), self.roi)]
        windows += [(("points", i, "roi"), p.roi) for i, p in enumerate(self.points) if p.roi is not None]
        size = (self.sensor.width, self.sensor.height)
        found = [
            (path, f"reaches beyond the sensor of {size[0]} x {size[1]} pixels")
            for path, roi in windows
            if roi.x + roi.width > size[0] or roi.y + roi.height > size[1]
        ]
        if found:
            raise problems_at(found)
        return self
