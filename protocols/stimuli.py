"""The three stimuli of a protocol file: square wave, reset and test pulses, constant light."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from protocols.axes import ContrastScale
from protocols.base import Contrast, Frequency, FrozenModel, Illuminance, Seconds, problems_at
from protocols.points import Preamble

__all__ = [
    "ConstantStimulus",
    "LevelContrast",
    "PreambleChoice",
    "ResetContrast",
    "ResetTestStimulus",
    "SquareStimulus",
    "StimulusChoice",
]


class LevelContrast(FrozenModel):
    """The contrast of the reset pulse at one light level."""

    illuminance_lux: Illuminance
    """Baseline illuminance on chip, lux; one of those that are swept."""
    value: Contrast
    """Contrast, in the scale given beside the list."""


class ResetContrast(FrozenModel):
    """Contrast of the reset pulse: one for all levels, or one for each."""

    scale: ContrastScale
    """linear: c, with E_max/E_min = 1 + c. log: ln(E_max/E_min). threshold: in units of the log contrast at which
    the return of the reset pulse just fires the opposite event and so re-arms a noise-free pixel."""
    value: Contrast | None = None
    """The contrast at every level."""
    by_level: Annotated[tuple[LevelContrast, ...], Field(min_length=1)] | None = None
    """The contrast at each level."""

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        if (self.value is None) == (self.by_level is None):
            raise ValueError("needs one of value and by_level")
        levels = [entry.illuminance_lux for entry in self.by_level or ()]
        repeated = [i for i, level in enumerate(levels) if level in levels[:i]]
        if repeated:
            raise problems_at((("by_level", i), f"{levels[i]:g} lux is given twice") for i in repeated)
        return self

    def at(self, illuminance_lux: float) -> float | None:
        """Return the contrast at a level, in the scale of the file; None if the list lacks the level."""
        for entry in self.by_level or ():
            if abs(entry.illuminance_lux - illuminance_lux) <= 1e-9 * illuminance_lux:
                return entry.value
        return self.value


class PreambleChoice(FrozenModel):
    """Pulses with unequal gaps before all others: without triggers they tell when the stimulus began."""

    contrast: Contrast = 4.0
    """Linear contrast c of the pulses, E_max/E_min = 1 + c. The larger, the sooner all pixels answer."""
    edges: Literal[4, 6, 8, 10] = 8
    """Edges of the preamble. Eight can lose some of their answers and still tell one period from the next."""
    unit_s: Seconds = 0.04
    """The shortest gap between two of them, s; longer than the sensor takes to answer."""

    def to_preamble(self) -> Preamble:
        """Return it as a plain dataclass."""
        return Preamble(math.log1p(self.contrast), self.edges, self.unit_s)


class SquareStimulus(FrozenModel):
    """A periodic square wave between the baseline and a brighter level."""

    kind: Literal["square"]
    """A square wave."""
    frequency_hz: Frequency | None = None
    """Periods per second; left out where the pulse width is swept."""
    duty: Annotated[float, Field(strict=True, gt=0, lt=1)] = 0.5
    """Bright part of a period."""
    preamble: PreambleChoice | None = None
    """What comes before the first period; nothing if left out."""


class ResetTestStimulus(FrozenModel):
    """Pairs of a reset pulse, whose return re-arms the pixel, and a test pulse, whose response is counted."""

    kind: Literal["reset_test"]
    """Reset and test pulses."""
    polarity: Literal["on", "off"] | None = None
    """Which response is tested: on, by a brighter test pulse; off, by a darker one. Left out where it is swept."""
    gap_s: Seconds = 0.1
    """Baseline before each pulse, s; at least the refractory period and 5 time constants of the pixel."""
    reset_s: Seconds
    """Length of the reset pulse, s."""
    reset_contrast: ResetContrast
    """Contrast of the reset pulse."""
    reset_direction: Literal["same", "opposite"] = "same"
    """Whether the reset pulse goes in the direction of the test pulse or the other way."""
    test_s: Seconds | None = None
    """Length of the test pulse, s; left out where the pulse width is swept."""
    window_s: Seconds | None = None
    """Response window, s, counted from the leading edge of the test pulse; as long as the test pulse if left out."""
    preamble: PreambleChoice | None = None
    """What comes before the first pulse; nothing if left out."""


class ConstantStimulus(FrozenModel):
    """One level: every event is background."""

    kind: Literal["constant"]
    """Constant light."""
    duration_s: Seconds
    """Length of the recording, s."""


StimulusChoice = Annotated[SquareStimulus | ResetTestStimulus | ConstantStimulus, Field(discriminator="kind")]
