"""When a run waits, and goes on by itself once what kept it is over: the section `suspend` of a protocol."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from protocols.base import FrozenModel, Number, PathProblem, Seconds, problems_at

__all__ = ["Ambient", "LightSettled", "Suspend", "TemperatureRange", "UsbErrors"]

Temperature = Annotated[Number, Field(ge=-100, le=200)]
Mebibytes = Annotated[Number, Field(gt=0, le=1e9)]
Fraction = Annotated[Number, Field(gt=0, lt=1)]
Factor = Annotated[Number, Field(gt=1, le=1e6)]
Count = Annotated[int, Field(strict=True, ge=0, le=1_000_000_000)]
PointCount = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]


class TemperatureRange(FrozenModel):
    """Between which temperatures of the sensor points are taken; a side that is left out has no limit."""

    low: Temperature | None = None
    """Lowest, degrees Celsius."""
    high: Temperature | None = None
    """Highest, degrees Celsius."""

    @model_validator(mode="after")
    def _is_a_range(self) -> Self:
        if self.low is None and self.high is None:
            raise problems_at([((), "needs low or high, or both")])
        if self.low is not None and self.high is not None and self.low >= self.high:
            raise problems_at([(("low",), f"is {self.low:g} C; expected less than high, which is {self.high:g} C")])
        return self


class LightSettled(FrozenModel):
    """How steady the light has to be, for a source that measures its own light."""

    within: Fraction
    """Largest difference of its readings, as a share of the largest of them."""
    within_s: Seconds
    """Over so long a time, s."""


class Ambient(FrozenModel):
    """How often to look whether light of the room reaches the sensor: a short recording with the source dark.

    It is compared with one that is taken when the run begins.
    """

    every_points: PointCount | None = None
    """Look after so many points."""
    every_s: Seconds | None = None
    """Look after so long a time, s; in place of `every_points`."""
    at_most_factor: Factor = 3.0
    """The events in the dark may be so many times those at the beginning."""

    @model_validator(mode="after")
    def _one_interval(self) -> Self:
        if (self.every_points is None) == (self.every_s is None):
            raise problems_at([((), "needs either every_points or every_s")])
        return self


class UsbErrors(FrozenModel):
    """How many errors the transfer from the camera may have: decode errors, dropped transfers, overflows."""

    at_most: Count
    """So many are let pass..."""
    per_s: Seconds
    """...in so long a time, s."""


class Suspend(FrozenModel):
    """When the run waits before the next point. It goes on by itself."""

    temperature_c: TemperatureRange | None = None
    """While the sensor is too cold or too warm."""
    disk_free_mib: Mebibytes | None = 200.0
    """While the disk of the run folder has less room than this, MiB; null to never look."""
    light_settled: LightSettled | None = None
    """While the light is not steady; only with a source that measures its own light."""
    ambient: Ambient | None = None
    """While light of the room reaches the sensor."""
    usb_errors: UsbErrors | None = None
    """While the transfer from the camera has too many errors."""
    check_every_s: Seconds = 30.0
    """How often a run that waits looks again, s."""
    give_up_after_s: Seconds = 3600.0
    """How long it waits at most, s."""
    then: Literal["pause", "stop"] = "pause"
    """After that: wait for the operator, or end the run, which can be resumed."""

    @model_validator(mode="after")
    def _looks_in_time(self) -> Self:
        found: list[PathProblem] = []
        if self.check_every_s > self.give_up_after_s:
            text = (
                f"is {self.check_every_s:g} s; expected at most give_up_after_s, which is {self.give_up_after_s:g} s"
            )
            found.append((("check_every_s",), text))
        if found:
            raise problems_at(found)
        return self
