"""A model laid beside a run: its numbers fitted, and every statistic measured and predicted."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from bench.diagnosis.expected.gate import cautions_of, findings_of
from bench.diagnosis.expected.residuals import slope_of
from bench.diagnosis.fitting.judging import step_of
from bench.diagnosis.session import open_session

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy.typing as npt

    from bench.compute import Workforce
    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.expected.residuals import Measured
    from bench.diagnosis.fitting.fitted import Fit
    from bench.diagnosis.result import Step
    from bench.diagnosis.views.base import Part
    from bench.store import Run
    from sim_backend.pixel.model import PixelModel

    Floats = npt.NDArray[np.float64]
    #: By the number of a step: residuals, and their (n, n) correlation where it is known.
    ResidualsByStep = Mapping[int, tuple[Sequence["Residual"], Floats | None]]

__all__ = ["Comparison", "Residual", "compare", "correlation_of", "residuals_by_step", "residuals_of"]


@dataclass(frozen=True, slots=True)
class Residual:
    """One statistic of one point, measured and predicted."""

    view: str
    part: Part
    point: int
    baseline_lux: float
    log_contrast: float  #: of the test pulse; 0 for background
    width_s: float  #: of the test pulse; NaN for background
    nd_od: float
    observed: float
    predicted: float
    sigma: float  #: standard error of the difference, about, in the unit of both
    z: float  #: the difference in standard errors, on the scale on which they are even
    unit: str = "1"


@dataclass(frozen=True)
class Comparison:
    """A fitted model beside a run."""

    runs: tuple[str, ...]
    findings: tuple[str, ...]  #: why the data are not fit to be judged; empty: they are
    step: Step  #: without candidates
    residuals: tuple[Residual, ...]
    correlation: Floats = field(repr=False, compare=False)  #: (n, n) of the residuals, as the model expects it
    model: PixelModel = field(compare=False)  #: fitted
    shortened: str = ""  #: how much of the recordings was looked at, where it was not all
    cautions: tuple[str, ...] = ()  #: what is to be known of data that are fit to be judged


def compare(
    runs: Sequence[Run], model: PixelModel | None = None, *, seed: int = 1, workforce: Workforce | None = None,
    tell: Callable[[str], None] | None = None, whole: bool = False,
) -> Comparison:  # fmt: skip
    """Fit the free numbers of a model to runs of one sensor, and lay both side by side.

    Parameters
    ----------
    model
        None for the base pixel alone.
    seed
        Of the simulations; the same seed gives the same comparison.
    workforce
        Who simulates; None for this process.
    tell
        Called with what is being done.
    whole
        Look at all of long recordings, and not at their beginnings.

    Raises
    ------
    InputError
        There are no points, the runs are of different sensors, or the model limits the readout of windows of which a
        part is looked at.
    """
    say = tell or (lambda _: None)
    say("looking at the events")
    with open_session(runs, model, workforce, whole=whole) as session:
        problem = session.problem
        say("fitting the model")
        found = session.fit(seed)
        shown = residuals_of(problem, found)
        mutual = correlation_of(problem, found)
        findings = findings_of(problem)
        return Comparison(
            session.ids, findings, step_of(problem, found), shown, mutual, found.model, session.shortened,
            cautions=() if findings else cautions_of(problem),
        )  # fmt: skip


def residuals_of(problem: Problem, one: Fit) -> tuple[Residual, ...]:
    """Return all statistics that were measured and that the model predicts, point after point."""
    of, z = problem.measured, one.z
    sigma = _in_their_unit(of, one)
    return tuple(
        Residual(
            view=of.labels[i].view,
            part=of.labels[i].part,
            point=of.labels[i].point,
            baseline_lux=of.labels[i].baseline_lux,
            log_contrast=of.labels[i].log_contrast,
            width_s=of.labels[i].width_s,
            nd_od=of.labels[i].nd_od,
            observed=float(of.ratio[i]),
            predicted=float(one.ratio[i]),
            sigma=float(sigma[i]),
            z=float(z[i]),
            unit=of.labels[i].unit,
        )
        for i in _known(one)
    )


def residuals_by_step(problem: Problem, fits: Sequence[Fit]) -> ResidualsByStep:
    """Return the residuals of the model of each step, and their correlation, by the number of the step."""
    return {n: (residuals_of(problem, one), correlation_of(problem, one)) for n, one in enumerate(fits)}


def _known(one: Fit) -> list[int]:
    """Return the places of the statistics that say something."""
    return np.flatnonzero(one.known).tolist()


def _in_their_unit(of: Measured, one: Fit) -> Floats:
    """Return the standard errors in the unit of the label: shares and counts were transformed."""
    sigma = np.asarray(one.deviation * math.sqrt(one.caution))
    slope = slope_of(of.kinds, one.ratio, of.bottom)
    return np.where(slope > 0.0, sigma / np.where(slope > 0.0, slope, 1.0), sigma)


def correlation_of(problem: Problem, one: Fit) -> Floats:
    """Return the (n, n) correlation of the residuals of :func:`residuals_of`; points count as independent."""
    full = np.eye(len(one.deviation))
    for root, where in zip(one.roots, problem.measured.points, strict=True):
        mix = np.linalg.pinv(root)
        covariance = mix @ mix.T
        scale = np.sqrt(np.where(np.diag(covariance) > 0.0, np.diag(covariance), 1.0))
        full[where, where] = covariance / np.outer(scale, scale)
    np.fill_diagonal(full, 1.0)
    known = _known(one)
    return np.asarray(full[np.ix_(known, known)])
