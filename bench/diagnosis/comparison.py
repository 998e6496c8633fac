"""A model laid beside a run: its numbers fitted, and every statistic measured and predicted."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.tally import active_pixels
from bench.diagnosis.expected.gate import cautions_of, findings_of
from bench.diagnosis.expected.residuals import slope_of
from bench.diagnosis.fitting.fitted import KNOWN
from bench.diagnosis.fitting.judging import step_of
from bench.diagnosis.session import on_its_clock, open_session
from bench.diagnosis.views.registry import views

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Mapping, Sequence

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

__all__ = ["Comparison", "Residual", "at_once", "compare", "correlation_of", "residuals_by_step", "residuals_of"]

#: Views that add up to the events in the response windows, per pixel and pulse.
_OF_ANSWERS: Final = frozenset({"response", "extra_events"})
#: Views by which no fit goes are looked at in simulated sensors of another seed, in the time of so many runs.
_CLOSER: Final = 100
_EFFORT: Final = 4.0


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
    at_once: float = math.nan  #: events of all pixels that one such pulse brings; NaN for background
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
        say("looking closer")
        shown, mutual = _all_residuals(session.problem, found, seed + _CLOSER)
        findings = findings_of(problem)
        return Comparison(
            session.ids, findings, step_of(problem, found), shown, mutual, found.model, session.shortened,
            cautions=() if findings else cautions_of(problem),
        )  # fmt: skip


def _all_residuals(problem: Problem, one: Fit, seed: int) -> tuple[tuple[Residual, ...], Floats]:
    """Return the residuals of all views, also of those by which no fit goes, and their correlation."""
    closer = on_its_clock(problem, one.slots, one.x).with_shown()
    sensors = closer.simulate([one.models(closer)], seed, _EFFORT)[0]
    here, of = closer.expect(sensors), closer.measured
    predicted, deviation, residual = here.ratio.copy(), here.deviation.copy(), of.value - here.value
    ids = {view.id for view in views()}
    fitted = np.array([label.view in ids for label in of.labels], np.bool_)
    predicted[fitted], deviation[fitted], residual[fitted] = one.ratio, one.deviation, one.residual
    known = np.flatnonzero(deviation < KNOWN)
    found = _residuals(closer, predicted, deviation * math.sqrt(one.caution), residual, known)
    return found, _correlation(here.scatter.covariance, of.points)[np.ix_(known, known)]


def residuals_of(problem: Problem, one: Fit) -> tuple[Residual, ...]:
    """Return all statistics that were measured and that the model predicts, point after point."""
    deviation = one.deviation * math.sqrt(one.caution)
    return _residuals(problem, one.ratio, deviation, one.residual, np.flatnonzero(one.known))


def _residuals(
    problem: Problem, predicted: Floats, deviation: Floats, residual: Floats, which: npt.NDArray[np.intp]
) -> tuple[Residual, ...]:  # fmt: skip
    of, together = problem.measured, at_once(problem)
    sigma, z = _in_their_unit(of, predicted, deviation), residual / deviation
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
            predicted=float(predicted[i]),
            sigma=float(sigma[i]),
            z=float(z[i]),
            at_once=together.get(of.labels[i].group, math.nan),
            unit=of.labels[i].unit,
        )
        for i in which
    )


def at_once(problem: Problem) -> dict[Hashable, float]:
    """Return how many events of all pixels together one pulse brings, on average, for each group of pulses.

    Of the polarity that is asked for, in the response window: these come at once, and wait for each other.
    """
    pixels = {p.index: int(active_pixels(p).sum()) for p in problem.points}
    found: dict[Hashable, float] = {}
    for label, ratio in zip(problem.measured.labels, problem.measured.ratio, strict=True):
        if label.view in _OF_ANSWERS:
            found[label.group] = found.get(label.group, 0.0) + pixels[label.point] * float(ratio)
    return found


def residuals_by_step(problem: Problem, fits: Sequence[Fit]) -> ResidualsByStep:
    """Return the residuals of the model of each step, and their correlation, by the number of the step."""
    return {n: (residuals_of(problem, one), correlation_of(problem, one)) for n, one in enumerate(fits)}


def _in_their_unit(of: Measured, predicted: Floats, deviation: Floats) -> Floats:
    """Return the standard errors in the unit of the label: shares and counts were transformed."""
    slope = slope_of(of.kinds, predicted, of.bottom)
    return np.where(slope > 0.0, deviation / np.where(slope > 0.0, slope, 1.0), deviation)


def correlation_of(problem: Problem, one: Fit) -> Floats:
    """Return the (n, n) correlation of the residuals of :func:`residuals_of`; points count as independent."""
    mixes = (np.linalg.pinv(root) for root in one.roots)
    known = np.flatnonzero(one.known)
    return _correlation([mix @ mix.T for mix in mixes], problem.measured.points)[np.ix_(known, known)]


def _correlation(covariances: Sequence[Floats], points: Sequence[slice]) -> Floats:
    """(n, n) correlation of statistics with these covariances in each point."""
    full = np.eye(sum(len(c) for c in covariances))
    for covariance, where in zip(covariances, points, strict=True):
        scale = np.sqrt(np.where(np.diag(covariance) > 0.0, np.diag(covariance), 1.0))
        full[where, where] = covariance / np.outer(scale, scale)
    np.fill_diagonal(full, 1.0)
    return full
