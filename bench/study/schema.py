"""The schema of a study file, format ``evs-bench-study/1``: pixels whose truth is known, measured as protocols say.

A study lists variants (a pixel, and the stimuli that it is shown), grids of variants, and claims: what somebody says
of the outcome, with the expected number and the tolerance, both written down before anything is run.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from bench.study.claim_schema import Claim, CurveName, Name, Text
from bench.study.figure_schema import Figure
from protocols.axes import Contrasts
from protocols.base import Contrast, FrozenModel, Number, PathProblem, Seconds, problems_at
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["FORMAT", "Effort", "Grid", "Reset", "Stimulus", "Study", "Variant"]

FORMAT = "evs-bench-study/1"

Count = Annotated[int, Field(strict=True, ge=1, le=100_000)]
Axis = Annotated[tuple[Number, ...], Field(min_length=1)]


def _is_pixel(values: dict[str, Any]) -> dict[str, Any]:
    """Refuse what is no pixel model, at the key of the pixel."""
    from sim_backend.pixel.model import PixelModel

    try:
        PixelModel.from_dict(values)
    except InputError as error:
        raise problems_at(((), p.message) for p in error.problems) from None
    return values


Pixel = Annotated[dict[str, Any], AfterValidator(_is_pixel)]


class Effort(FrozenModel):
    """How much is measured of each curve."""

    window: Annotated[int, Field(strict=True, ge=1, le=256)]
    """Width and height of the window of pixels."""
    pulses: Count
    """Test pulses of each point; for a square wave, periods."""
    recordings: Count
    """Recordings of constant light; the first so many points of their protocol."""


class Stimulus(FrozenModel):
    """The light and the contrasts, as a protocol has them; the pixel of a variant replaces its settings."""

    protocol: Text
    """A ready-made protocol, or a protocol file."""
    measurement: str | None = None
    """One measurement of it; all of them if left out."""


class Reset(FrozenModel):
    """What differs from the reset and test pulses of the protocol."""

    reset_contrast: Contrast | None = None
    """Linear contrast of the reset pulse."""
    gap_s: Seconds | None = None
    """Baseline before each pulse, s."""
    reset_s: Seconds | None = None
    """Length of the reset pulse, s."""
    test_s: Seconds | None = None
    """Length of the test pulse, s."""
    window_s: Seconds | None = None
    """Response window from the edge of the test pulse, s."""


class Variant(FrozenModel):
    """One pixel, and what it is shown."""

    name: Name
    """Each only once."""
    title: Text
    """One line for the report."""
    printed: str = ""
    """What of it the text of the paper gives; the rest was chosen here."""
    stimuli: Annotated[tuple[Name, ...], Field(min_length=1)]
    """Names of the stimuli."""
    pixel: Pixel
    """Keys of a pixel model; what is left out has the model's default."""
    engine: Literal["fast", "exact", "euler"] = "fast"
    """fast: from event to event; exact and euler: sample by sample, with either form of the low-pass."""
    contrast: Contrasts | None = None
    """Contrasts in place of the protocol's."""
    reset: Reset = Reset()
    """What differs from the protocol's reset and test pulses."""
    window: Annotated[int, Field(strict=True, ge=1, le=256)] | None = None
    """Width and height of the window in place of the effort's; pixels without noise are all alike."""
    pulses: Count | None = None
    """Pulses in place of the effort's."""
    polarities: Annotated[tuple[Literal["on", "off"], ...], Field(min_length=1)] = ("on", "off")
    """Polarities that reset and test pulses ask for."""
    theta: Literal["never", "full", "always"] = "never"
    """Whether the threshold of a noisy pixel is fitted too, which takes longer than all else."""
    in_quick: bool = True
    """Whether a quick run takes it too, unless it is asked for by its name."""
    at: dict[str, float] = Field(default_factory=dict)
    """Where the variant lies in its grid; empty for one that stands by itself."""


class Grid(FrozenModel):
    """Variants along axes: every combination, or one axis at a time with the others at the base."""

    name: Name
    """Each only once; the variants are called NAME_1, NAME_2 and so on."""
    title: Text
    """One line for the report."""
    stimuli: Annotated[tuple[Name, ...], Field(min_length=1)]
    """Names of the stimuli."""
    pixel: Pixel
    """Keys of the pixel model that all have in common."""
    reset: Reset = Reset()
    """Reset and test pulses at the base."""
    polarities: Annotated[tuple[Literal["on", "off"], ...], Field(min_length=1)] = ("on", "off")
    """Polarities that reset and test pulses ask for."""
    theta: Literal["never", "full", "always"] = "never"
    """As in a variant."""
    window: Annotated[int, Field(strict=True, ge=1, le=256)] | None = None
    """As in a variant."""
    pulses: Count | None = None
    """As in a variant."""
    one_at_a_time: bool = False
    """One axis at a time instead of every combination."""
    axes: Annotated[dict[str, Axis], Field(min_length=1)]
    """Values by the name of a key of the pixel or of the reset."""
    quick: dict[str, Axis] = Field(default_factory=dict)
    """Fewer values for the quick run; an axis that is not named keeps its first value."""

    @model_validator(mode="after")
    def _axes_are_known(self) -> Self:
        found = [(("axes", a), f"is no axis; known are {', '.join(_axes())}") for a in self.axes if a not in _axes()]
        found += [(("quick", a), "is not among the axes") for a in self.quick if a not in self.axes]
        if found:
            raise problems_at(found)
        return self

    def variants(self, *, quick: bool) -> tuple[Variant, ...]:
        """Return the variants of the grid; on a quick run those of the few values only."""
        axes = {name: self.quick.get(name, values[:1]) for name, values in self.axes.items()} if quick else self.axes
        return tuple(self._variant(i, at) for i, at in enumerate(self._places(axes), start=1))

    def _places(self, axes: Mapping[str, Sequence[float]]) -> list[dict[str, float]]:
        """Return every combination of axes, or one axis at a time."""
        if not self.one_at_a_time:
            return [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]
        return [{name: value} for name, values in axes.items() for value in values]

    def _variant(self, number: int, at: dict[str, float]) -> Variant:
        reset = {name: value for name, value in at.items() if name in Reset.model_fields}
        pixel = {name: value for name, value in at.items() if name not in reset}
        return Variant(
            name=f"{self.name}_{number}",
            title=f"{self.title}: {', '.join(f'{name} {value:g}' for name, value in at.items())}",
            stimuli=self.stimuli,
            pixel=self.pixel | pixel,
            reset=self.reset.model_copy(update=reset),
            polarities=self.polarities,
            theta=self.theta,
            window=self.window,
            pulses=self.pulses,
            at=at,
        )


def _axes() -> tuple[str, ...]:
    return ("noise_rms", "corner_hz", "theta_on", "theta_off", "refractory_s", *Reset.model_fields)


class Study(FrozenModel):
    """Variants, grids and claims."""

    format: Literal["evs-bench-study/1"]
    """Name and version of the format."""
    title: Text
    """One line."""
    description: str = ""
    """What it is about."""
    effort: Effort
    """How much is measured in a full run."""
    quick: Effort
    """How much is measured in a quick run."""
    stimuli: Annotated[dict[Name, Stimulus], Field(min_length=1)]
    """The stimuli, by name."""
    variants: Annotated[tuple[Variant, ...], Field(min_length=1)]
    """Pixels, and what each is shown."""
    grids: tuple[Grid, ...] = ()
    """Variants along axes."""
    claims: tuple[Claim, ...] = ()
    """What is said of the outcome."""
    figures: tuple[Figure, ...] = ()
    """Figures of the report, in order."""

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        found: list[PathProblem] = []
        for key in ("variants", "grids", "claims", "figures"):
            names = [item.name for item in getattr(self, key)]
            found += [((key, i, "name"), f"{n!r} is given twice") for i, n in enumerate(names) if n in names[:i]]
            for i, item in enumerate(getattr(self, key) if key in ("variants", "grids") else ()):
                found += [
                    ((key, i, "stimuli", j), f"there is no stimulus {s!r}; there are {', '.join(self.stimuli)}")
                    for j, s in enumerate(item.stimuli)
                    if s not in self.stimuli
                ]
        for i, claim in enumerate(self.claims):
            for key, curves in (("of", claim.of), ("minus", claim.minus)):
                found += [(("claims", i, key, j), text) for j, text in self._unknown(curves)]
        for i, figure in enumerate(self.figures):
            for k, panel in enumerate(figure.panels):
                place = ("figures", i, "panels", k, "curves")
                found += [((*place, j, "of"), text) for j, text in self._unknown([c.of for c in panel.curves])]
        if found:
            raise problems_at(found)
        return self

    def _unknown(self, curves: Sequence[str]) -> list[tuple[int, str]]:
        measured = {variant.name: variant.stimuli for variant in self.variants}
        found = []
        for j, curve in enumerate(map(CurveName.parse, curves)):
            if curve.variant not in measured:
                found.append((j, f"there is no variant {curve.variant!r}"))
            elif curve.stimulus not in measured[curve.variant]:
                found.append((j, f"variant {curve.variant} is not shown {curve.stimulus!r}"))
        return found
