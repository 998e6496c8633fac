"""The keys that ask for more contrasts where a curve is steep."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from protocols.base import FrozenModel

__all__ = ["MOST_ADDED", "Refine", "Until"]

MOST_ADDED = 1000  #: to one curve

StandardError = Annotated[float, Field(strict=True, gt=0, le=1, allow_inf_nan=False)]
ProbabilityStep = Annotated[float, Field(strict=True, gt=0, lt=1, allow_inf_nan=False)]


class Until(FrozenModel):
    """When a curve is known well enough; one of `theta_se`, `half_se` and `gap`."""

    theta_se: StandardError | None = None
    """Standard error of the threshold, natural log units: that of a noisy pixel, as `analyze` gives it."""
    half_se: StandardError | None = None
    """Standard error of the 50 % point, natural log units, as `analyze` gives it."""
    gap: ProbabilityStep | None = None
    """The largest step of the response probability from one contrast to the next."""

    @model_validator(mode="after")
    def _one_criterion(self) -> Self:
        given = [name for name in ("theta_se", "half_se", "gap") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"needs one of theta_se, half_se and gap, not {' and '.join(given) or 'none'}")
        return self


class Refine(FrozenModel):
    """Contrasts that are added to each curve while it is taken, where its probability rises."""

    until: Until
    """When a curve is known well enough, so that nothing more is added."""
    at_most: Annotated[int, Field(strict=True, ge=1, le=MOST_ADDED)]
    """So many contrasts are added to each curve at most, whether it is known well enough or not."""
