"""The schema of a station file, format ``evs-bench-station/1``."""

from __future__ import annotations

import datetime
import math
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import Field, StringConstraints, model_validator

from protocols.base import CLASS_PATTERN, FrozenModel, Number, PathProblem, problems_at

__all__ = [
    "BareGeometry",
    "BiasCurveSection",
    "CalibrationSection",
    "FilterSection",
    "LensGeometry",
    "LightSection",
    "RoleSection",
    "RolesSection",
    "SensorSection",
    "StationFile",
    "WorldSection",
]

Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Fraction = Annotated[Number, Field(gt=0, le=1)]
Count = Annotated[int, Field(strict=True, ge=1, le=65535)]
Offset = Annotated[int, Field(strict=True)]
Text = Annotated[str, StringConstraints(min_length=1)]
ClassPath = Annotated[str, StringConstraints(pattern=CLASS_PATTERN)]


class RoleSection(FrozenModel):
    """Who plays a role."""

    driver: Text
    """``package.module:Class``, or the name of an entry point of the group ``evs_bench.drivers``."""
    args: dict[str, Any] = Field(default_factory=dict)
    """Arguments of its constructor. ``$world``, ``$clock``, ``$bias_map`` and ``$true_bias_map`` stand for what the
    station has."""


class RolesSection(FrozenModel):
    """The instruments of a bench."""

    light: RoleSection
    wheel: RoleSection
    camera: RoleSection
    clock: RoleSection
    """The time in which the bench lives: ``drivers.clock:RealClock`` on a real one."""


class SensorSection(FrozenModel):
    """The sensor, as it is believed to be."""

    name: Text
    width: Count
    height: Count
    pixel_pitch_m: Annotated[Number, Field(gt=1e-7, lt=1e-3)]
    quantum_efficiency: Fraction
    """Averaged over the spectrum of the light."""
    photons_per_lux: Positive = 1.12e16
    """Per square metre and second, for the spectrum of the light."""


class BareGeometry(FrozenModel):
    """A bare sensor on the axis of a Lambertian disc: ``E = pi L r^2 / (r^2 + d^2)``."""

    kind: Literal["bare"]
    distance_mm: NotNegative
    port_radius_mm: Positive

    @property
    def lux_per_luminance(self) -> float:
        """Illuminance on the chip per luminance, lux per cd/m2."""
        r2 = self.port_radius_mm**2
        return math.pi * r2 / (r2 + self.distance_mm**2)


class LensGeometry(FrozenModel):
    """A lens that images the Lambertian source: ``E = pi L T / (4 N^2 (1 + m)^2)``."""

    kind: Literal["lens"]
    f_number: Positive
    transmittance: Fraction
    magnification: NotNegative = 0.0

    @property
    def lux_per_luminance(self) -> float:
        """Illuminance on the chip per luminance, lux per cd/m2."""
        return math.pi * self.transmittance / (4.0 * self.f_number**2 * (1.0 + self.magnification) ** 2)


class LightSection(FrozenModel):
    """Lux on the chip, without a filter."""

    unit: Text
    """Unit of the source's level; it must be that of the driver."""
    lux_per_level: Positive | None = None
    """Measured. Where it is left out it follows from the geometry, for a source whose unit is cd/m2."""
    geometry: Annotated[BareGeometry | LensGeometry, Field(discriminator="kind")] | None = None
    date: datetime.date | None = None
    """When it was measured."""
    uncertainty: NotNegative | None = None
    """Relative, one standard deviation."""

    @model_validator(mode="after")
    def _known(self) -> LightSection:
        if self.lux_per_level is None and (self.geometry is None or self.unit != "cd/m2"):
            raise problems_at(
                [((), "lux_per_level is missing, and only a geometry and the unit cd/m2 can replace it")]
            )
        return self

    @property
    def clear_lux_per_level(self) -> float:
        """Lux on the chip per unit of the level, measured or else from the geometry."""
        if self.lux_per_level is not None:
            return self.lux_per_level
        if self.geometry is None:
            raise ValueError("neither lux_per_level nor a geometry")
        return self.geometry.lux_per_luminance


class FilterSection(FrozenModel):
    """One ND filter."""

    nd_od: NotNegative
    """Nominal optical density, 0 for the clear position."""
    transmission: Fraction
    """Measured with this source: a filter is not the same in every light."""
    date: datetime.date | None = None
    """When it was measured."""
    uncertainty: NotNegative | None = None
    """Relative, one standard deviation."""


class BiasCurveSection(FrozenModel):
    """One quantity against the offset of one bias, with straight lines between the rows."""

    bias: Text
    scale: Literal["linear", "log"] = "log"
    """Whether the value or its logarithm is linear in the offset between two rows."""
    table: Annotated[list[tuple[Offset, Number]], Field(min_length=2)]
    """Rows of offset and value, with ascending offsets and values that only rise or only fall."""
    calibrated: bool
    """Whether it was measured on this sensor."""
    uncertainty: list[NotNegative] | None = None
    """Of the value of each row: relative, one standard deviation."""
    date: datetime.date | None = None
    """When it was measured."""

    @model_validator(mode="after")
    def _monotone(self) -> BiasCurveSection:
        problems: list[PathProblem] = []
        rising = self.table[-1][1] > self.table[0][1]
        for i, ((offset, value), (next_offset, next_value)) in enumerate(pairwise(self.table), start=1):
            if next_offset <= offset:
                problems.append((("table", i, 0), f"offset {next_offset} does not ascend from {offset}"))
            if next_value == value or (next_value > value) != rising:
                direction = "rise" if rising else "fall"
                problems.append((("table", i, 1), f"value {next_value:g} does not {direction} from {value:g}"))
        if self.scale == "log":
            problems += [
                (("table", i, 1), f"value {value:g} must be above 0 on a log scale")
                for i, (_, value) in enumerate(self.table)
                if value <= 0.0
            ]
        if self.uncertainty is not None and len(self.uncertainty) != len(self.table):
            rows = f"{len(self.uncertainty)} values for a table of {len(self.table)} rows"
            problems.append((("uncertainty",), f"{rows}; expected one for each row"))
        if problems:
            raise problems_at(problems)
        return self


class BiasMapSection(FrozenModel):
    """What the biases do, by quantity. A quantity that is left out cannot be asked for on this station."""

    theta_on: BiasCurveSection | None = None
    """ON threshold, ln units."""
    theta_off: BiasCurveSection | None = None
    """OFF threshold, ln units."""
    refractory_s: BiasCurveSection | None = None
    """Dead time after an event, s."""
    bandwidth_hz: BiasCurveSection | None = None
    """Corner of the source follower, Hz."""


class WorldSection(FrozenModel):
    """What the devices of a simulated station share. Their arguments refer to it as ``$world``."""

    class_path: ClassPath = Field(alias="class")
    """Where it is: ``package.module:Class``."""
    args: dict[str, Any] = Field(default_factory=dict)
    """Arguments of its constructor."""
    bias_map: BiasMapSection | None = None
    """What the biases really do, where that is not what the calibration says; ``$true_bias_map`` in arguments."""


class CalibrationSection(FrozenModel):
    """What is known of the bench."""

    light: LightSection
    filters: Annotated[dict[Text, FilterSection], Field(min_length=1)]
    bias_map: BiasMapSection = BiasMapSection()

    @model_validator(mode="after")
    def _different_filters(self) -> CalibrationSection:
        names = list(self.filters)
        problems = [
            (("filters", name, "nd_od"), f"filter {other} has optical density {self.filters[other].nd_od:g} too")
            for i, name in enumerate(names)
            for other in names[:i]
            if self.filters[other].nd_od == self.filters[name].nd_od
        ]
        if problems:
            raise problems_at(problems)
        return self


class StationFile(FrozenModel):
    """A station file: which driver plays which role, with its arguments and its calibration."""

    format: Literal["evs-bench-station/1"]
    name: Text
    description: str = ""
    world: WorldSection | None = None
    sealed_world: Text | None = None
    """File with the world of a blind station, beside this one; :mod:`bench.station.sealed` opens it."""
    roles: RolesSection
    sensor: SensorSection
    calibration: CalibrationSection

    @model_validator(mode="after")
    def _one_world(self) -> StationFile:
        if self.world is not None and self.sealed_world is not None:
            raise problems_at([(("sealed_world",), "there is a world beside it; give one of the two")])
        return self
