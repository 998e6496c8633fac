"""The schema of a protocol file, format ``evs-bench-protocol/1``.

A protocol is a frozen pydantic model. One that loads can be expanded: everything that a combination of keys can get
wrong is found when it is read, with its place in the file.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from protocols.axes import Sweep
from protocols.base import NAME_PATTERN, FrozenModel, problems_at
from protocols.expected import Expected
from protocols.points import Ambient, Point
from protocols.policy import Policy
from protocols.settings import Expect, RoiChoice, SettingsChoice, SettleChoice
from protocols.stimuli import StimulusChoice
from protocols.suspend import Suspend

if TYPE_CHECKING:
    from protocols.estimation import Estimate
    from protocols.refining import RefinedCurve

__all__ = ["FORMAT", "Measurement", "Operator", "Protocol"]

FORMAT = "evs-bench-protocol/1"

Seed = Annotated[int, Field(strict=True, ge=0, le=2**63 - 1)]
Pulses = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]


class Operator(FrozenModel):
    """What a person has to do."""

    before: Annotated[str, Field(min_length=1)]
    """Shown before the first point of the measurement; the run waits until it is confirmed."""


class Measurement(FrozenModel):
    """One stimulus, and the axes that are swept. What is left out here is taken from the protocol."""

    name: Annotated[str, Field(pattern=NAME_PATTERN, max_length=80)]
    """Name of the measurement; each only once."""
    stimulus: StimulusChoice
    """The light over time."""
    sweep: Sweep
    """The axes."""
    ambient: Ambient = "open"
    """Whether light from the room can reach the sensor."""
    operator: Operator | None = None
    """What a person has to do for this measurement."""
    pulses: Pulses | None = None
    """Test pulses of each point; for a square wave, periods."""
    settings: SettingsChoice | None = None
    """Settings that differ from those of the protocol."""
    settle: SettleChoice | None = None
    """Settling times that differ from those of the protocol."""
    roi: RoiChoice | None = None
    """The window of pixels, in place of the protocol's."""
    seed: Seed | None = None
    """The seed, in place of the protocol's."""


class Protocol(FrozenModel):
    """What to measure."""

    format: Literal["evs-bench-protocol/1"]
    """Name and version of the format."""
    title: Annotated[str, Field(min_length=1)]
    """One line: what is measured."""
    description: str = ""
    """What it is for, and how to read the result."""
    seed: Seed = 0
    """Seed of everything random: shuffled orders and simulated recordings."""
    roi: RoiChoice
    """The window of pixels."""
    expect: Expect | None = None
    """What the sensor is believed to be."""
    settings: SettingsChoice = SettingsChoice()
    """What the sensor is asked to be."""
    settle: SettleChoice = SettleChoice()
    """How long to wait before a recording starts."""
    pulses: Pulses | None = None
    """Test pulses of each point; for a square wave, periods."""
    order: Literal["as_written", "shuffled"] = "as_written"
    """Order of the contrasts at one condition; shuffled by the seed, a slow drift does not look like contrast."""
    policy: Policy = Policy()
    """What the run does when something goes wrong and nobody is there."""
    suspend: Suspend = Suspend()
    """When the run waits until the conditions are right again."""
    measurements: Annotated[tuple[Measurement, ...], Field(min_length=1)]
    """What is measured, in the order in which it is taken as far as filters and settings allow."""

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        from protocols.consistency import problems_of

        found = problems_of(self)
        if found:
            raise problems_at(found)
        return self

    def expand(self) -> tuple[Point, ...]:
        """Return the numbered points that are taken in any case, in the order in which they are taken.

        See :func:`protocols.expansion.expand` for the order.
        """
        from protocols.expansion import expand

        return expand(self)

    def refined_curves(self) -> tuple[RefinedCurve, ...]:
        """Return the curves to which points may be added while they are taken; see :mod:`protocols.refining`."""
        from protocols.refining import refined_curves

        return refined_curves(self)

    def worst_case(self) -> tuple[Point, ...]:
        """Return the points as they are taken if every curve needs all that may be added to it.

        Contrasts of those that are added stand for what is not known yet; all else of them is as it will be.
        """
        from protocols.refining import worst_case

        return worst_case(self)

    def estimate(self) -> Estimate:
        """Return how long the protocol takes, and how large its run becomes, at most.

        See :func:`protocols.estimation.estimate` for the formula.
        """
        from protocols.estimation import estimate

        added = sum(len(curve.spare) for curve in self.refined_curves())
        return estimate(self.worst_case(), added)

    def expected_at(self, point: Point) -> Expected:
        """Return what the sensor is expected to be at `point`: what its settings prescribe, else `expect`."""
        return self.believed().under(point.settings)

    def believed(self) -> Expected:
        """Return `expect` as a plain dataclass; all unknown if the file has none."""
        return self.expect.to_expected() if self.expect else Expected()

    def resolved(self) -> dict[str, Any]:
        """Return the protocol with every default, override and axis spelled out, as plain data.

        It is a protocol again, and expands into the same points.
        """
        from protocols.resolution import resolved

        return resolved(self)
