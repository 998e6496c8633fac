"""A diagnosis as a person reads it at a terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.diagnosis.result import Candidate, Misfit, Outcome, Step

__all__ = ["lines_of", "step_lines", "verdict_line"]

_SHOWN: Final = 5
_SMALLEST_P: Final = 0.001


def lines_of(diagnosis: Outcome) -> Iterator[str]:
    """Yield the lines of a whole diagnosis."""
    for step in diagnosis.steps:
        yield from step_lines(step)
    yield verdict_line(diagnosis)


def step_lines(step: Step) -> Iterator[str]:
    """Yield the lines of one step: the model, its error, where it fails most, and what it may lack."""
    what = ", ".join(e.replace("_", " ") for e in step.effects if e != "alignment")
    if step.added is not None:
        what = f"+ {step.added} {_numbers(step)}"
    error = step.error
    yield f"step {step.number}  {what}"
    yield (
        f"        error {error.deviance_per_dof:.3g}   on unseen points {error.heldout_deviance_per_dof:.3g}"
        f"   response rms {error.response_rmse:.3f}   floor 1.00"
    )
    if step.worst:
        yield f"        fails most: {_worst(step.worst[0])}"
    shown = [c for c in step.candidates if c.screen_drop > 0.0][:_SHOWN]
    if shown:
        width = max(9, *(len(c.effect) for c in shown))
        yield f"        {'candidate':{width}}  expected fall  after refit  p"
        for c in shown:
            yield f"        {_row(c, width)}"


def verdict_line(diagnosis: Outcome) -> str:
    """Return the verdict in one sentence."""
    if diagnosis.verdict == "data_not_fit_to_judge":
        return f"verdict: the data are not fit to be judged: {'; '.join(diagnosis.findings)}"
    first, last = diagnosis.steps[0].error, diagnosis.steps[-1].error
    fall = f"the error fell from {first.deviance_per_dof:.3g} to {last.deviance_per_dof:.3g}"
    names = ", ".join(_with_ties(diagnosis, name) for name in diagnosis.missing)
    many = "one effect was" if len(diagnosis.missing) == 1 else f"{len(diagnosis.missing)} effects were"
    if diagnosis.verdict == "nothing_missing":
        return f"verdict: nothing is missing; the error is {first.deviance_per_dof:.3g}."
    if diagnosis.verdict == "explained":
        return f"verdict: {many} missing, {names}; {fall}; nothing else is significant."
    if diagnosis.missing:
        return f"verdict: unexplained. {names} helps, {fall}, but something is left that no known effect explains."
    return f"verdict: unexplained. No known effect explains the error of {first.deviance_per_dof:.3g}."


def _numbers(step: Step) -> str:
    mine = [(k, v) for k, v in step.parameters.items() if k.split(".")[0] == step.added]
    return ", ".join(f"{v.value:.3g} {v.unit} ({v.low:.3g} to {v.high:.3g})" for _, v in mine)


def _with_ties(diagnosis: Outcome, name: str) -> str:
    tied = diagnosis.ties.get(name, ())
    return f"{name} (or {' or '.join(tied)})" if tied else name


def _worst(one: Misfit) -> str:
    contrast = f", contrast {one.log_contrast:.3g}" if one.log_contrast > 0.0 else ""
    return (
        f"{one.view.replace('_', ' ')} at {one.baseline_lux:g} lux{contrast}: measured {one.observed:.3g}, "
        f"model {one.predicted:.3g} ({one.z:+.1f} sigma)"
    )


def _row(one: Candidate, width: int) -> str:
    refit = (
        f"{one.refit_drop:11.1f}" if one.refit_drop is not None and math.isfinite(one.refit_drop) else f"{'-':>11}"
    )
    p = f"< {_SMALLEST_P:g}" if one.p_value < _SMALLEST_P else f"{one.p_value:.3f}"
    tied = f"   cannot be told from {', '.join(one.tied_with)} here" if one.tied_with else ""
    return f"{one.effect:{width}}  {one.screen_drop:13.1f}  {refit}  {p}{tied}".rstrip()
