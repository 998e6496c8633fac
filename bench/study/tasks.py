"""One task: one variant shown one stimulus, simulated and analysed. Tasks are independent and know nothing else."""

from __future__ import annotations

import hashlib
import math
import time
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

from protocols.contrasts import PlanProblem
from protocols.errors import InputError
from protocols.points import Point, ResetTestTiming
from protocols.settings import RoiChoice, SettingsChoice
from protocols.stimuli import ConstantStimulus, ResetContrast, ResetTestStimulus

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.analysis.curves import ThetaFitter
    from bench.analysis.results import BackgroundRow, ResponseRow, SCurve
    from bench.study.schema import Effort, Reset, Stimulus, Study, Variant
    from protocols.schema import Measurement, Protocol
    from sim_backend.pixel.engines.base import Engine

__all__ = ["Outcome", "Task", "run_task", "tasks_of"]

_ORIGIN: Final = 0
_DT_S: Final = 1e-5  # the published one


@dataclass(frozen=True, slots=True)
class Task:
    """Everything that is needed to measure one variant with one stimulus; it can be sent to another process."""

    variant: str
    stimulus: str
    points: tuple[Point, ...]
    pixel: dict[str, Any]  #: keys of the pixel model
    engine: str  #: fast, exact or euler
    fit_theta: bool  #: whether the threshold of a noisy pixel is fitted too


@dataclass(frozen=True, slots=True)
class Outcome:
    """What was read off one variant with one stimulus."""

    variant: str
    stimulus: str
    curves: tuple[SCurve, ...]  #: ON and OFF, as far as they were asked for
    background: tuple[BackgroundRow, ...]  #: of constant light
    fitted: bool  #: whether thresholds of noisy pixels were looked for
    reset_ln: float  #: log contrast of the reset pulses; NaN without
    seconds: float  #: that it took

    def curve(self, polarity: str) -> SCurve | None:
        """Return the S-curve of one polarity, or None."""
        return next((c for c in self.curves if c.key.polarity == polarity), None)


def run_task(task: Task) -> Outcome:
    """Simulate and analyse one task. The same task gives the same outcome, wherever it runs."""
    from bench.analysis import analyze
    from bench.study.simulate import SimulatedRun
    from sim_backend.pixel.model import PixelModel

    begin = time.monotonic()
    name = f"{task.variant}, {task.stimulus}"
    run = SimulatedRun(task.points, PixelModel.from_dict(task.pixel), _engine(task.engine), name)
    timing = task.points[0].timing
    reset = timing if isinstance(timing, ResetTestTiming) else None
    fit = _theta_fit(reset.gap_s - run.model.refractory_s) if reset and task.fit_theta else _no_theta
    found = analyze(run, pixel_maps=False, theta_fit=fit)
    reset_ln = reset.reset_log_contrast if reset else math.nan
    seconds = time.monotonic() - begin
    return Outcome(
        variant=task.variant,
        stimulus=task.stimulus,
        curves=found.curves,
        background=found.background,
        fitted=task.fit_theta,
        reset_ln=reset_ln,
        seconds=seconds,
    )


def _theta_fit(armed_s: float) -> ThetaFitter:
    """Return a fit of the threshold that knows the gap, the dead time and the grid of the samples."""
    from bench.analysis.noisy_pixel import fit_theta

    return lambda rows: fit_theta(rows, armed_s=armed_s, grid_s=_DT_S)


def _no_theta(rows: Sequence[ResponseRow]) -> None:
    del rows


def _engine(name: str) -> Engine:
    """Return the engine of that name, on one thread: tasks run side by side instead."""
    from sim_backend.pixel import FastEngine, ReferenceEngine

    if name == "fast":
        return FastEngine(dt_s=_DT_S, threads=1)
    return ReferenceEngine(dt_s=_DT_S, step="euler" if name == "euler" else "exact", threads=1)


def tasks_of(study: Study, variant: Variant, seed: int, *, quick: bool) -> tuple[Task, ...]:
    """Return the tasks of one variant, one for each of its stimuli.

    Parameters
    ----------
    seed
        Of the study. Each task has random numbers of its own, so that their results are independent.
    quick
        Whether the effort of a quick run is meant.

    Raises
    ------
    InputError
        The protocol cannot be read, lacks the measurement, or cannot be altered so.
    """
    effort = study.quick if quick else study.effort
    fit_theta = variant.theta == "always" or (variant.theta == "full" and not quick)
    return tuple(
        Task(
            variant=variant.name,
            stimulus=name,
            points=_points(study.stimuli[name], variant, effort, seed),
            pixel=variant.pixel,
            engine=variant.engine,
            fit_theta=fit_theta,
        )
        for name in variant.stimuli
    )


def _points(stimulus: Stimulus, variant: Variant, effort: Effort, seed: int) -> tuple[Point, ...]:
    """Return the points of the protocol's measurements, altered as the variant says."""
    from pydantic import ValidationError

    protocol = _protocol(stimulus.protocol)
    names = [m.name for m in protocol.measurements]
    if stimulus.measurement is not None and stimulus.measurement not in names:
        raise InputError(
            f"{stimulus.protocol} has no measurement {stimulus.measurement!r}; it has {', '.join(names)}"
        )
    wanted = [m for m in protocol.measurements if stimulus.measurement in (None, m.name)]
    if isinstance(wanted[0].stimulus, ConstantStimulus):
        wanted = wanted[: effort.recordings]
    side = variant.window or effort.window
    changes = {
        "seed": _seed(seed, variant.name, stimulus.protocol),
        "roi": RoiChoice(x=_ORIGIN, y=_ORIGIN, width=side, height=side),
        "settings": SettingsChoice(),
        "pulses": variant.pulses or effort.pulses,
        "measurements": tuple(_altered(m, variant) for m in wanted),
    }
    try:
        return type(protocol)(**(dict(protocol) | changes)).expand()
    except (ValidationError, PlanProblem) as error:
        raise InputError(f"variant {variant.name} cannot be shown {stimulus.protocol}: {_first(error)}") from None


@lru_cache(maxsize=8)
def _protocol(name: str) -> Protocol:
    """Return a protocol; each is read once, for many variants are shown the same."""
    from protocols import load_protocol

    return load_protocol(name).protocol


def _first(error: Exception) -> str:
    problems = getattr(error, "errors", None)
    return str(problems()[0]["msg"]) if problems else str(error)


def _seed(seed: int, *names: str) -> int:
    """Return a seed of its own for each name, 0 to 2^63 - 1."""
    digest = hashlib.sha256("/".join((str(seed), *names)).encode()).digest()
    return int.from_bytes(digest[:8], "big") >> 1


def _altered(measurement: Measurement, variant: Variant) -> Measurement:
    """Return the measurement without axes of settings: the pixel says what they are."""
    sweep = measurement.sweep.model_copy(
        update={"thresholds": None, "refractory_period_s": None, "bandwidth_hz": None, "biases": {}, "roi": None}
    )
    if variant.contrast is not None and sweep.contrast is not None:
        sweep = sweep.model_copy(update={"contrast": variant.contrast})
    stimulus = measurement.stimulus
    if isinstance(stimulus, ResetTestStimulus):
        stimulus = _with_reset(stimulus, variant.reset)
        stimulus = stimulus.model_copy(update={"polarity": None})
        sweep = sweep.model_copy(update={"polarity": variant.polarities})
    return measurement.model_copy(
        update={"sweep": sweep, "stimulus": stimulus, "settings": None, "roi": None, "seed": None, "pulses": None}
    )


def _with_reset(stimulus: ResetTestStimulus, reset: Reset) -> ResetTestStimulus:
    changes: dict[str, Any] = {k: v for k, v in dict(reset).items() if v is not None and k != "reset_contrast"}
    if reset.reset_contrast is not None:
        changes["reset_contrast"] = ResetContrast(scale="linear", value=reset.reset_contrast)
    return stimulus.model_copy(update=changes)
