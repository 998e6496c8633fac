"""What is left over, of points that say something."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from bench.diagnosis.searching.remainder import remainder_of


def point(contrast: float) -> Any:
    at = np.zeros(3)
    return SimpleNamespace(
        baseline_lux=10.0, log_contrast=contrast, nd_od=0.0, pulse_start_s=at, pulse_stop_s=at + 0.08
    )


def test_a_point_of_which_nothing_is_known_has_no_remainder() -> None:
    """All of its pulses lie in gaps."""
    known, unknown = np.eye(20), np.zeros((20, 20))
    label = SimpleNamespace(view="response", part="on")
    problem: Any = SimpleNamespace(
        points=[point(0.3), point(0.5)],
        measured=SimpleNamespace(points=[slice(0, 20), slice(20, 40)], labels=[label] * 40),
    )
    residual = np.full(40, 9.0)
    fit = SimpleNamespace(roots=(known, unknown), residual=residual, scale=1.0, z=residual, known=np.arange(40) < 20)
    state: Any = SimpleNamespace(fit=fit, trends=())
    found = {(r.axis, r.where) for r in remainder_of(problem, state)}
    assert ("contrast", "0.3") in found
    assert ("contrast", "0.5") not in found
