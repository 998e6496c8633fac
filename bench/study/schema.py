"""The schema of a study file, format ``evs-bench-study/1``: pixels whose truth is known, measured as protocols say.

A study lists variants (a pixel, and the stimuli that it is shown), grids of variants, and claims: what somebody says
of the outcome, with the expected number and the tolerance, both written down before anything is run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from protocols.axes import Contrasts
from protocols.base import Contrast, FrozenModel, Number, PathProblem, Seconds, problems_at
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = [
    "FORMAT",
    "Claim",
    "CurveName",
    "DrawnCurve",
    "Effort",
    "Figure",
    "Grid",
    "LightStep",
    "Panel",
    "Reset",
    "Stimulus",
    "Study",
    "Variant",
]

FORMAT = "evs-bench-study/1"

Name = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_]*$", max_length=60)]
Text = Annotated[str, Field(min_length=1)]
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
        from bench.study.grids import places

        axes = {name: self.quick.get(name, values[:1]) for name, values in self.axes.items()} if quick else self.axes
        return tuple(self._variant(i, at) for i, at in enumerate(places(axes, self), start=1))

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
