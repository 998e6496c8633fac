"""Between standard errors and 90 % intervals."""

from __future__ import annotations

from typing import Final

from bench.analysis.results import Estimate
from bench.photometry.propagation import Known

__all__ = ["Z90", "as_estimate", "as_known"]

Z90: Final = 1.6448536269514722  #: half of a 90 % interval, standard errors


def as_estimate(value: float, sd: float, unit: str) -> Estimate:
    """Return a number with the 90 % interval of its standard error."""
    return Estimate(value, value - Z90 * sd, value + Z90 * sd, unit)


def as_known(estimate: Estimate) -> Known:
    """Return a number with the standard error of its 90 % interval."""
    return Known(estimate.value, (estimate.high - estimate.low) / (2.0 * Z90))
