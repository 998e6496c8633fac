"""The figures that a study file asks for."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from bench.study.claim_schema import Curve, Name, Text
from protocols.base import FrozenModel

__all__ = ["DrawnCurve", "Figure", "Panel"]


class DrawnCurve(FrozenModel):
    """One S-curve in a figure."""

    of: Curve
    """The result."""
    label: Text
    """What the legend calls it."""


class Panel(FrozenModel):
    """One set of axes with S-curves."""

    title: Text
    """Above the axes."""
    curves: Annotated[tuple[DrawnCurve, ...], Field(min_length=1)]
    """What is drawn; the true threshold of each is marked."""


class Figure(FrozenModel):
    """A figure of the report."""

    name: Name
    """Each only once; the name of its files."""
    title: Text
    """Above the figure."""
    caption: Text
    """Below it."""
    draws: Literal["curves", "theory", "waveform", "memory", "dark_light", "bias", "reset"] = "curves"
    """curves: S-curves in panels; theory: curves of a pixel with noise, calculated; waveform: the reset and test
    pulses; memory: what a pixel memorises in one period; dark_light: contrast needed near the dark limit; bias and
    reset: the grids of these names."""
    panels: tuple[Panel, ...] = ()
    """For curves."""

    @model_validator(mode="after")
    def _panels_are_for_curves(self) -> Self:
        if (self.draws == "curves") != bool(self.panels):
            raise ValueError("curves are drawn in panels, and only they are")
        return self
