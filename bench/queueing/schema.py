"""The schema of a queue file, format ``evs-bench-queue/1``."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StringConstraints, model_validator

from protocols.base import NAME_PATTERN, FrozenModel, Number, problems_at

__all__ = ["OnFailure", "QueueEntry", "QueueFile", "ReferenceSection", "WarmUpSection"]

Text = Annotated[str, StringConstraints(min_length=1)]
Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
Seed = Annotated[int, Field(strict=True, ge=0, lt=2**62)]
Count = Annotated[int, Field(strict=True, ge=1, le=1000)]
Minutes = Annotated[Number, Field(gt=0, le=1440)]
Rate = Annotated[Number, Field(gt=0, le=100)]

OnFailure = Literal["next", "stop"]


class WarmUpSection(FrozenModel):
    """What to wait for before a run, with the camera switched on and the light dark."""

    seconds: Annotated[Number, Field(gt=0, le=86400)] | None = None
    minutes: Minutes | None = None
    until_degc_per_minute: Rate | None = None
    """Go on when the temperature of the sensor changes by less than this in a minute, degrees Celsius."""
    at_most_minutes: Minutes | None = None
    """How long to wait for that at most."""

    @model_validator(mode="after")
    def _one_kind(self) -> WarmUpSection:
        kinds = [k for k in ("seconds", "minutes", "until_degc_per_minute") if getattr(self, k) is not None]
        if len(kinds) != 1:
            raise problems_at([((), "give one of seconds, minutes and until_degc_per_minute")])
        if (self.until_degc_per_minute is None) != (self.at_most_minutes is None):
            raise problems_at([((), "until_degc_per_minute and at_most_minutes go together")])
        return self

    @property
    def longest_s(self) -> float:
        """The longest that this takes, s."""
        if self.seconds is not None:
            return self.seconds
        return 60.0 * (self.minutes or self.at_most_minutes or 0.0)


class QueueEntry(FrozenModel):
    """A protocol to run, once or several times."""

    protocol: Text
    """Name of a ready-made protocol, or path of a file relative to this one."""
    station: Text | None = None
    """A shipped station, or path of a file relative to this one; default is that of the whole queue."""
    repeat: Count = 1
    seed: Seed | None = None
    """Seed of a simulated run, in place of those of the protocol; a repetition takes the next number."""
    name: Name | None = None
    """Name of its run folders; default is that of the protocol."""
    on_failure: OnFailure | None = None
    """What to do if it fails: take the next run, or stop the queue; default is that of the whole queue."""
    warm_up: WarmUpSection | None = None


class ReferenceSection(FrozenModel):
    """A run that is repeated through the queue, so that drift is seen."""

    protocol: Text
    """Name of a ready-made protocol, or path of a file relative to this one."""
    station: Text | None = None
    """As in an entry."""
    every: Count | None = None
    """After so many runs of entries."""
    every_minutes: Minutes | None = None
    """After so much planned time of entries."""
    seed: Seed | None = None
    name: Name = "reference"

    @model_validator(mode="after")
    def _one_of_the_two(self) -> ReferenceSection:
        if (self.every is None) == (self.every_minutes is None):
            raise problems_at([((), "give one of every (runs) and every_minutes")])
        return self


class QueueFile(FrozenModel):
    """What to run, in which order."""

    format: Literal["evs-bench-queue/1"]
    title: str = ""
    on_failure: OnFailure = "next"
    """What to do if a run fails and its entry does not say."""
    reference: ReferenceSection | None = None
    entries: Annotated[tuple[QueueEntry, ...], Field(min_length=1)]
