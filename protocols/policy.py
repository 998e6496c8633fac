"""What a run does when nobody is there: when a device fails, when a point is bad, when a step hangs."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from protocols.base import FrozenModel, WaitingTime

__all__ = ["Deadline", "OnBadPoint", "OnFailure", "Policy", "Reconnect"]

Retries = Annotated[int, Field(strict=True, ge=0, le=1000)]
Attempts = Annotated[int, Field(strict=True, ge=1, le=1000)]
Factor = Annotated[float, Field(strict=True, ge=1, le=1000, allow_inf_nan=False)]


class OnFailure(FrozenModel):
    """What to do when a device fails while a point is taken."""

    retries: Retries = 0
    """How often a point is tried again."""
    wait_s: WaitingTime = 5.0
    """How long to wait before each new trial, s; the light is dark meanwhile."""
    then: Literal["skip", "pause", "abort"] = "abort"
    """After the last trial: leave the point out, wait for the operator, or end the run."""


class OnBadPoint(FrozenModel):
    """What to do when a point was taken, and its data are judged bad."""

    retries: Retries = 0
    """How often a point is taken again."""
    budget: Retries = 20
    """How many points are taken again for that reason in the whole run, at most."""
    then: Literal["keep", "skip"] = "keep"
    """After the last one: keep it, marked as bad, or leave the point out of the evaluation."""


class Reconnect(FrozenModel):
    """How devices are reached again after one failed: all are closed, connected, and must be the same ones."""

    attempts: Attempts = 3
    """How often it is tried."""
    wait_s: WaitingTime = 5.0
    """How long to wait between two trials, s."""


class Deadline(FrozenModel):
    """How long a step may take; one that takes longer counts as a device that failed."""

    factor: Factor = 3.0
    """So many times what the step should take."""
    at_least_s: Annotated[float, Field(strict=True, gt=0, le=1e5, allow_inf_nan=False)] = 120.0
    """Never less than this, s."""


class Policy(FrozenModel):
    """What a run does when something goes wrong and nobody is there. Left out, the first failure ends it."""

    on_failure: OnFailure = OnFailure()
    """When a device fails."""
    on_bad_point: OnBadPoint = OnBadPoint()
    """When the data of a point are judged bad."""
    reconnect: Reconnect = Reconnect()
    """How devices are reached again."""
    deadline: Deadline | None = None
    """How long a step may take; without it, as long as the devices' own time-outs allow."""
