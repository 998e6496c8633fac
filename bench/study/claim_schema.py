"""What a study file says of the outcome: curves by name, claims with the number that would bear them out."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from protocols.base import Contrast, FrozenModel, Number

__all__ = ["Claim", "Curve", "CurveName", "LightStep", "Name", "Text"]

Name = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_]*$", max_length=60)]
Text = Annotated[str, Field(min_length=1)]


class CurveName(FrozenModel):
    """One result: of which variant, which stimulus, which polarity."""

    variant: str
    stimulus: str
    polarity: Literal["on", "off", "both"]  #: both: of constant light, ON and OFF together

    @classmethod
    def parse(cls, text: str) -> Self:
        """Return the name that is written VARIANT/STIMULUS/POLARITY."""
        parts = text.split("/")
        if len(parts) != 3 or parts[2] not in ("on", "off", "both"):
            raise ValueError(f"{text!r} is no curve; write variant/stimulus/on, off or both")
        return cls(variant=parts[0], stimulus=parts[1], polarity=parts[2])


def _is_curve(text: str) -> str:
    CurveName.parse(text)
    return text


Curve = Annotated[str, AfterValidator(_is_curve)]

Quantity = Literal["half", "intercept", "theta", "plateau", "rate", "reset_over_threshold", "dark_light_ratio"]


class LightStep(FrozenModel):
    """A step of the light that just gives an event."""

    lux: Annotated[float, Field(strict=True, gt=0)]
    """From this illuminance on chip, lux."""
    log_contrast: Contrast
    """By this log contrast."""
    theta: Contrast
    """At this threshold, ln."""


class Claim(FrozenModel):
    """What is said of the outcome, and what number would bear it out."""

    name: Name
    """Each only once."""
    by: Literal["paper", "us"]
    """Who says it: the paper, or we."""
    source: Text
    """Where it stands."""
    says: Text
    """What is said, in words."""
    quantity: Quantity
    """half, intercept, theta: contrasts in ln; plateau: a probability; rate: of background events, Hz;
    reset_over_threshold: log contrast of the reset pulse over the threshold under test; dark_light_ratio: of the dark
    light that the two `steps` give."""
    of: tuple[Curve, ...] = ()
    """Results whose numbers are added."""
    minus: tuple[Curve, ...] = ()
    """Results whose numbers are taken away."""
    steps: tuple[LightStep, ...] = ()
    """Two steps of the light at the threshold, for dark_light_ratio; nothing is simulated for it."""
    unit: Literal["threshold", "less_sensitive", "ln", "1", "Hz"]
    """threshold: over the true threshold of the polarity; less_sensitive: over the larger of the two."""
    expected: Number | None = None
    """The number expected."""
    tolerance: Annotated[float, Field(strict=True, gt=0)] | None = None
    """How far the number may be from it."""
    factor: Annotated[float, Field(strict=True, gt=1)] | None = None
    """By what factor the number may be off, in place of a tolerance."""
    above: Number | None = None
    """The number is above this, in place of an expected one."""
    below: Number | None = None
    """The number is below this."""
    otherwise: Text
    """Why, where it does not come out so."""

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        spread = (self.tolerance is not None) + (self.factor is not None)
        if self.expected is not None and (spread != 1 or self.above is not None or self.below is not None):
            raise ValueError("expected needs one of tolerance and factor, and neither above nor below")
        if self.expected is None and (spread or (self.above is None) == (self.below is None)):
            raise ValueError("needs expected with tolerance or factor, or one of above and below")
        wanted = 2 if self.quantity == "dark_light_ratio" else 0
        if len(self.steps) != wanted or bool(self.of) == bool(self.steps):
            raise ValueError(
                "dark_light_ratio needs two steps and no curves; every other quantity needs curves in of"
            )
        return self

    @property
    def limits(self) -> tuple[float, float]:
        """Lowest and highest number that bear the claim out."""
        if self.expected is None:
            low = -float("inf") if self.above is None else self.above
            return low, float("inf") if self.below is None else self.below
        if self.factor is not None:
            return self.expected / self.factor, self.expected * self.factor
        spread = self.tolerance or 0.0
        return self.expected - spread, self.expected + spread
