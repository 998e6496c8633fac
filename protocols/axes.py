"""What a measurement sweeps: lists of numbers, contrasts, filters."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from protocols.base import Contrast, FrozenModel, Illuminance, Number, PathProblem, problems_at
from protocols.refine import Refine
from protocols.settings import RoiChoice, Thresholds

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = [
    "ContrastScale",
    "Contrasts",
    "Linspace",
    "LinspaceAxis",
    "Logspace",
    "LogspaceAxis",
    "NdBelow",
    "Numbers",
    "Sweep",
    "numbers",
]

ContrastScale = Literal["linear", "log", "threshold"]

Count = Annotated[int, Field(strict=True, ge=2, le=100_000)]
OpticalDensity = Annotated[float, Field(strict=True, ge=0, le=12, allow_inf_nan=False)]
BiasOffset = Annotated[int, Field(strict=True, ge=-255, le=255)]
PositiveNumber = Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)]


class Linspace(FrozenModel):
    """Evenly spaced numbers, both ends included."""

    start: Number
    """First value."""
    stop: Number
    """Last value."""
    num: Count
    """How many values, at least 2."""

    def numbers(self) -> tuple[float, ...]:
        """Return the values."""
        step = (self.stop - self.start) / (self.num - 1)
        return (*(self.start + i * step for i in range(self.num - 1)), self.stop)


class Logspace(FrozenModel):
    """Numbers in equal ratios, both ends included; the ends are values, not exponents."""

    start: PositiveNumber
    """First value, above 0."""
    stop: PositiveNumber
    """Last value, above 0."""
    num: Count
    """How many values, at least 2."""

    def numbers(self) -> tuple[float, ...]:
        """Return the values."""
        step = (math.log(self.stop) - math.log(self.start)) / (self.num - 1)
        return (*(self.start * math.exp(i * step) for i in range(self.num - 1)), self.stop)


class LinspaceAxis(FrozenModel):
    """An axis of evenly spaced numbers."""

    linspace: Linspace

    def numbers(self) -> tuple[float, ...]:
        """Return the values."""
        return self.linspace.numbers()


class LogspaceAxis(FrozenModel):
    """An axis of numbers in equal ratios."""

    logspace: Logspace

    def numbers(self) -> tuple[float, ...]:
        """Return the values."""
        return self.logspace.numbers()


def _form(value: Any) -> str | None:
    """Tell in which of its forms an axis is written."""
    if isinstance(value, (list, tuple)):
        return "<list>"
    if isinstance(value, LinspaceAxis) or (isinstance(value, dict) and "linspace" in value):
        return "<linspace>"
    if isinstance(value, LogspaceAxis) or (isinstance(value, dict) and "logspace" in value):
        return "<logspace>"
    return "<number>" if isinstance(value, (int, float)) else None


Numbers = Annotated[
    Annotated[Number, Tag("<number>")]
    | Annotated[Annotated[tuple[Number, ...], Field(min_length=1)], Tag("<list>")]
    | Annotated[LinspaceAxis, Tag("<linspace>")]
    | Annotated[LogspaceAxis, Tag("<logspace>")],
    Discriminator(
        _form,
        custom_error_type="axis",
        custom_error_message="must be a number, a list of numbers, {linspace: {start, stop, num}} or "
        "{logspace: {start, stop, num}}",
    ),
]
"""An axis of numbers in any of its four forms."""


def numbers(axis: Numbers) -> tuple[float, ...]:
    """Return the values of an axis, whichever form it is written in."""
    if isinstance(axis, (LinspaceAxis, LogspaceAxis)):
        return axis.numbers()
    return axis if isinstance(axis, tuple) else (axis,)


def _between(lowest: float, highest: float, *, above: bool = False) -> AfterValidator:
    """Return a validator that refuses an axis with a value outside `lowest` to `highest`."""
    bound = f"above {lowest:g}" if above else f"at least {lowest:g}"

    def check(axis: Any) -> Any:
        found: list[PathProblem] = []
        for i, value in enumerate(numbers(axis)):
            place = (i,) if isinstance(axis, tuple) else ()
            if value < lowest or (above and value == lowest):
                found.append((place, f"{value:g} is out of range, must be {bound}"))
            elif value > highest:
                found.append((place, f"{value:g} is out of range, must be at most {highest:g}"))
        if found:
            raise problems_at(found if isinstance(axis, tuple) else found[:1])
        return axis

    return AfterValidator(check)


class Contrasts(FrozenModel):
    """Contrasts of the test pulse; one of `values`, `linspace` and `logspace`."""

    scale: ContrastScale
    """linear: c, with E_max/E_min = 1 + c. log: ln(E_max/E_min). threshold: in units of the log contrast at which a
    noise-free pixel of the expected threshold and dark light answers at that level."""
    values: Annotated[tuple[Contrast, ...], Field(min_length=1)] | None = None
    """The contrasts themselves."""
    linspace: Linspace | None = None
    """Evenly spaced contrasts."""
    logspace: Logspace | None = None
    """Contrasts in equal ratios."""
    refine: Refine | None = None
    """Contrasts that are added to each curve where it is steep, after these have been taken."""

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        given = [form for form in ("values", "linspace", "logspace") if getattr(self, form) is not None]
        if len(given) != 1:
            raise ValueError(f"needs one of values, linspace and logspace, not {' and '.join(given) or 'none'}")
        for space in (self.linspace, self.logspace):
            if space is not None and not (space.start > 0 and space.stop > 0):
                raise problems_at([((given[0],), "contrasts must be above 0")])
        if self.refine is not None and len(set(self.numbers())) < 2:
            raise problems_at([(("refine",), "needs at least two different contrasts to begin with")])
        return self

    def numbers(self) -> tuple[float, ...]:
        """Return the contrasts, in the scale of the file."""
        if self.values is not None:
            return self.values
        space = self.linspace or self.logspace
        return space.numbers() if space is not None else ()


class NdBelow(FrozenModel):
    """One ND filter for the low levels, none for the others."""

    od: OpticalDensity
    """Optical density of the filter."""
    below_lux: Illuminance
    """It is in for points whose baseline is below this, lux on chip."""


def _nd_form(value: Any) -> str | None:
    if isinstance(value, (list, tuple)):
        return "<list>"
    if isinstance(value, (dict, NdBelow)):
        return "<below>"
    return "<number>" if isinstance(value, (int, float)) else None


NdChoice = Annotated[
    Annotated[OpticalDensity, Tag("<number>")]
    | Annotated[Annotated[tuple[OpticalDensity, ...], Field(min_length=1)], Tag("<list>")]
    | Annotated[NdBelow, Tag("<below>")],
    Discriminator(
        _nd_form,
        custom_error_type="nd_od",
        custom_error_message="must be an optical density, a list of them, or {od, below_lux}",
    ),
]


def _no_repeats(what: str) -> Callable[[tuple[Any, ...]], tuple[Any, ...]]:
    def check(values: tuple[Any, ...]) -> tuple[Any, ...]:
        repeated = [((i,), f"{what} {v!r} is given twice") for i, v in enumerate(values) if v in values[:i]]
        if repeated:
            raise problems_at(repeated)
        return values

    return check


class Sweep(FrozenModel):
    """The axes of a measurement. Every combination of their values is one point."""

    illuminance_lux: Annotated[Numbers, _between(0, 1e6)]
    """Baseline illuminance on chip, lux: the level from which the test pulse steps (for a square wave, the lower)."""
    contrast: Contrasts | None = None
    """Contrast of the test pulse; not for constant light."""
    polarity: (
        Annotated[tuple[Literal["on", "off"], ...], Field(min_length=1), AfterValidator(_no_repeats("polarity"))]
        | None
    ) = None
    """Polarities of the test pulse, in place of the one of the stimulus; reset_test only."""
    pulse_width_s: Annotated[Numbers, _between(0, 1e5, above=True)] | None = None
    """Lengths of the test pulse (for a square wave, of the bright part), in place of the one of the stimulus, s."""
    nd_od: NdChoice = 0.0
    """Optical density of the ND filter; a list is an axis; 0 is no filter."""
    roi: Annotated[tuple[RoiChoice, ...], Field(min_length=1)] | None = None
    """Windows of pixels, in place of the one of the protocol."""
    thresholds: Annotated[tuple[Thresholds, ...], Field(min_length=1)] | None = None
    """Pairs of thresholds, in place of those of the settings."""
    refractory_period_s: Annotated[Numbers, _between(0, 100, above=True)] | None = None
    """Refractory periods, in place of the one of the settings, s."""
    bandwidth_hz: Annotated[Numbers, _between(0, 1e7, above=True)] | None = None
    """Corners of the source follower, in place of the one of the settings, Hz."""
    biases: dict[str, Annotated[tuple[BiasOffset, ...], Field(min_length=1)]] = Field(default_factory=dict)
    """For each bias a list of offsets from the factory code; each bias is an axis of its own."""
