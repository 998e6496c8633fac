"""The report of the study, as Markdown."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from benchmarks.dark_light.settings import SETTINGS

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

__all__ = ["report_text"]

_HEAD: Final = """# Dark light: how well it is found

Written by `python -m benchmarks.dark_light`. Fifteen simulated sensors of 16 x 16 pixels, whose dark current is
known; of each a family of ON curves from 76 mlux to 100 lux is taken again and again, with other noise and other
pixels. *Covered* is the share of runs whose 90 % interval holds the truth, with the standard error of that share;
*width* is the mean width of the interval beside the truth, *bias* that of the mean estimate. *By intercepts* is the
bias of the straight line through the 100 % intercepts: the usual way, which knows nothing of noise and bandwidth.
*Threshold covered* and *its bias* are those of the threshold in the same fit; *threshold denied* is the share of runs
in which the test (at 1 %) finds that it changes with the light; in truth it never does. *Seconds* are the mean of
real time for a run, simulation included, of two side by side on a computer that does other work too.

| sensor | runs | covered | width | bias | by intercepts | threshold covered | its bias | threshold denied | seconds |
|---|---|---|---|---|---|---|---|---|---|
"""


def report_text(records: Sequence[dict[str, Any]]) -> str:
    """Return the report of the finished runs."""
    rows = [_row(s.name, [r for r in records if r["setting"] == s.name]) for s in SETTINGS]
    return _HEAD + "\n".join(row for row in rows if row) + "\n"


def _row(name: str, records: Sequence[dict[str, Any]]) -> str:
    if not records:
        return ""
    true = records[0]["true_lux"]
    value, low, high = (np.array([r[key] for r in records], np.float64) for key in ("lux", "low", "high"))
    theta = np.array([[r["theta"], r["theta_low"], r["theta_high"]] for r in records], np.float64)
    theta /= records[0]["true_theta"]
    readings = np.array([r["by_intercept"] if r["by_intercept"] is not None else math.nan for r in records])
    denied = np.mean([r.get("constant_p", 1.0) < 0.01 for r in records])
    seconds = float(np.mean([r["seconds"] for r in records]))
    cells = (
        name, f"{len(records)}", _covered((low <= true) & (true <= high)), f"{np.mean(high - low) / true:.1%}",
        f"{np.mean(value) / true - 1.0:+.1%}", f"{np.nanmean(readings) / true - 1.0:+.0%}",
        _covered((theta[:, 1] <= 1.0) & (theta[:, 2] >= 1.0)), f"{np.mean(theta[:, 0]) - 1.0:+.1%}", f"{denied:.0%}",
        f"{seconds:.1f}",
    )  # fmt: skip
    return f"| {' | '.join(cells)} |"


def _covered(inside: npt.NDArray[np.bool_]) -> str:
    """Return the share of intervals that hold the truth, with its standard error."""
    share = float(np.mean(inside))
    return f"{share:.0%} +- {math.sqrt(max(share * (1.0 - share), 0.25 / inside.size) / inside.size):.0%}"
