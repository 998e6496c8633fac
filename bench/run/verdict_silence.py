"""Steps of the light that no pixel could miss, and that none answered."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from bench.run.verdict_case import red

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from bench.run.verdict_case import Case, Found

__all__ = ["silence"]

#: Pixels times steps below which silence may be chance, and steps at the end that make a silence.
_FEWEST_ANSWERS: Final = 20
_FEWEST_STEPS: Final = 2
#: Dead times that must pass between steps for both to be answered.
_DEAD_TIMES: Final = 1.2


def silence(case: Case) -> Iterator[Found]:
    """Yield that strong steps are not answered, all of them or all from some time on."""
    edge, rising = _strong_steps(case)
    if len(edge) < _FEWEST_STEPS or len(edge) * case.roi.pixels < _FEWEST_ANSWERS:
        return
    t_s = np.append(case.record.stimulus.t_s, case.record.duration_s)
    counted = case.seen.between(t_s[edge], t_s[edge + 1])
    answers = np.where(rising, counted[1], counted[0]) / case.roi.pixels
    silent = answers < case.limits.silent_below
    run = len(silent) - int(np.flatnonzero(~silent)[-1] + 1 if not silent.all() else 0)
    if run < _FEWEST_STEPS or run * case.roi.pixels < _FEWEST_ANSWERS:
        return
    strong = f"steps of the light of {case.limits.strong_step:g} thresholds or more"
    if silent.all():
        yield red(
            f"silence: {len(edge)} {strong}, and {answers.mean():.2g} answers per pixel and step; is the light on, "
            "and the cap off?"
        )
    else:
        yield red(f"silence from {t_s[edge[-run]]:.3g} s on: the last {run} of {len(edge)} {strong} are not answered")


def _strong_steps(case: Case) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
    """Return the edges that every pixel answers, and whether they rise."""
    point, limits, stimulus = case.planned.point, case.limits, case.record.stimulus
    if point.ambient == "capped" or len(stimulus.lux) < 2:
        return np.empty(0, np.int64), np.empty(0, bool)
    known = limits.dark_light_lux
    dark = limits.most_dark_light_lux if known is None else known
    level = np.log(np.maximum(stimulus.lux + dark, 1e-12))
    step = np.diff(level)
    theta_on = point.settings.theta_on or limits.highest_threshold
    theta_off = point.settings.theta_off or limits.highest_threshold
    strong = (step > limits.strong_step * theta_on) | (step < -limits.strong_step * theta_off)
    dead_s = case.record.refractory_s
    if np.isfinite(dead_s):
        strong &= np.diff(stimulus.t_s, prepend=-np.inf)[1:] > _DEAD_TIMES * dead_s
    edge = np.flatnonzero(strong) + 1
    inside = stimulus.t_s[edge] < case.record.duration_s
    return edge[inside], step[edge[inside] - 1] > 0.0
