"""Where a curve needs another contrast, and when it is known well enough.

The probability is what was measured, made into the nearest curve that never falls; between two contrasts it is taken
to rise in a straight line. The next contrast halves the step over which it rises most. That needs no model of the
pixel, brings a curve that is a step to its place as fast as any search, and puts the contrasts of a smooth one at
about equal distances in probability, or in its angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from bench.analysis.grouping import Entry
    from bench.analysis.results import Estimate
    from bench.analysis.scurve import CurveCounts
    from protocols.refine import Until

    Floats = npt.NDArray[np.float64]

__all__ = ["Known", "Standing", "Step", "halved", "known_of", "standing_of", "steps_of"]

#: A curve that rises by less is taken for a flat one; :mod:`bench.analysis.scurve` fits none that is flatter.
_SMALLEST_RISE: Final = 0.05
_HALF_INTERVAL: Final = 1.6448536269514722  #: of a 90 % interval, in standard errors
_QUARTER_TURN: Final = 0.5 * math.pi
#: No light is set to log contrasts that are finer.
_FINEST_LN: Final = 1e-4


@dataclass(frozen=True, slots=True)
class Known:
    """What is known of one response of a curve: that to its steps up, or to its steps down."""

    log_contrast: Floats  #: (n,) ascending
    probability: Floats  #: (n,) never falling
    error: float = math.nan  #: the standard error that is asked for, natural log units; NaN where it is not known

    @property
    def rises(self) -> bool:
        """Whether there is anything to be found."""
        return bool(self.probability.size and self.probability[-1] - self.probability[0] >= _SMALLEST_RISE)


@dataclass(frozen=True, slots=True)
class Standing:
    """How well a curve is known."""

    enough: bool
    text: str  #: for people


@dataclass(frozen=True, slots=True)
class Step:
    """Two neighbouring contrasts, and by how much the probability rises from one to the other."""

    low: float
    high: float
    rise: float

    @property
    def middle(self) -> float:
        """The contrast between them."""
        return 0.5 * (self.low + self.high)


def known_of(entries: Sequence[Entry], until: Until) -> Known:
    """Return what the answers of one response tell, with the standard error that is asked for."""
    from bench.analysis.grouping import curve_counts
    from bench.analysis.scurve import rising_means

    counts = curve_counts(entries)
    asked = counts.trials.sum(axis=1).astype(np.float64)
    some = asked > 0
    if not some.any():
        return Known(np.empty(0), np.empty(0))
    probability = counts.answers.sum(axis=1)[some] / asked[some]
    return Known(counts.log_contrast[some], rising_means(probability, asked[some]), _error(entries, counts, until))


def _error(entries: Sequence[Entry], counts: CurveCounts, until: Until) -> float:
    """Return the standard error that is asked for; NaN where it is not known, or none is asked for."""
    try:
        if until.theta_se is not None:
            return _theta_se(entries)
        return math.nan if until.half_se is None else _half_se(counts)
    except np.linalg.LinAlgError:  # a fit that fails must not end a night
        return math.nan


def _half_se(counts: CurveCounts) -> float:
    from bench.analysis.scurve import fit_curve

    return _standard_error(fit_curve(counts).half)


def _theta_se(entries: Sequence[Entry]) -> float:
    """Return the standard error of the threshold, as the analysis of the run will; NaN where it finds none."""
    from bench.analysis.grouping import curve_keys
    from bench.analysis.noisy_pixel import fit_theta
    from bench.analysis.responses import response_row

    keys = curve_keys(entries, [""] * len(entries))
    rows = [response_row(entry, key) for entry, key in zip(entries, keys, strict=True)]
    found = fit_theta(sorted(rows, key=lambda row: row.log_contrast))
    return math.nan if found is None else _standard_error(found.theta)


def _standard_error(estimate: Estimate) -> float:
    """Return what the half of a 90 % interval is of a normal distribution."""
    return 0.5 * (estimate.high - estimate.low) / _HALF_INTERVAL


def steps_of(tried: Sequence[float], known: Sequence[Known], until: Until) -> list[Step]:
    """Return the steps between all contrasts that were tried, in order; the rise is that of the steepest response.

    Contrasts without usable data count with what is expected there, so that none is tried twice. Where a standard
    error is asked for, the rise is that of the angle asin(sqrt(p)), in which all shares are known equally well.
    """
    contrast = np.unique([c for c in tried if math.isfinite(c)])
    risen = [np.interp(contrast, one.log_contrast, one.probability) for one in known if one.rises]
    if contrast.size < 2 or not risen:
        return []
    height = np.stack(risen) if until.gap is not None else np.arcsin(np.sqrt(np.stack(risen))) / _QUARTER_TURN
    rises = np.max(np.diff(height, axis=1), axis=0)
    rows = zip(contrast[:-1].tolist(), contrast[1:].tolist(), rises.tolist(), strict=True)
    return [Step(low, high, rise) for low, high, rise in rows]


def standing_of(until: Until, known: Sequence[Known], steps: Sequence[Step]) -> Standing:
    """Return how well a curve is known that rises."""
    if until.gap is not None:
        widest = max((step.rise for step in steps), default=0.0)
        return Standing(widest <= until.gap, f"its largest gap is {widest:.2g}")
    name, asked = ("theta_se", until.theta_se) if until.theta_se is not None else ("half_se", until.half_se)
    errors = [one.error for one in known if one.rises]
    if asked is None or not errors or not all(math.isfinite(error) for error in errors):
        return Standing(False, f"its {name} cannot be told yet")
    return Standing(max(errors) <= asked, f"its {name} is {max(errors):.2g}")


def halved(steps: Sequence[Step], most: int, enough: float, as_set: Callable[[float], float | None]) -> list[Step]:
    """Return up to `most` steps whose middle is the contrast to take next, the widest first.

    Parameters
    ----------
    steps
        The steps that there are.
    most
        How many contrasts are wanted.
    enough
        Steps that rise by no more are left as they are.
    as_set
        Returns what the light source makes of a contrast; None where it cannot be had.
    """
    left, found = list(steps), list[Step]()
    while len(found) < most and left:
        step = max(left, key=lambda one: one.rise)  # of equal ones the first: the same in each run
        left.remove(step)
        if step.rise <= enough:
            break
        contrast = as_set(step.middle) if step.high - step.low > _FINEST_LN else None
        if contrast is None or not _between(contrast, step):
            continue  # the light has nothing between the two
        found.append(step)
        left += [Step(step.low, contrast, 0.5 * step.rise), Step(contrast, step.high, 0.5 * step.rise)]
    return found


def _between(contrast: float, step: Step) -> bool:
    near = 1e-6 * step.high
    return step.low + near < contrast < step.high - near
