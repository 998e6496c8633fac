"""The report of the study, as Markdown."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from benchmarks.dark_light.settings import SETTINGS

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["report_text"]

_HEAD: Final = """# Dark light: how well it is found

Written by `python -m benchmarks.dark_light`. Fifteen simulated sensors of 16 x 16 pixels, whose dark current is
known; of each a family of ON curves from 76 mlux to 100 lux is taken again and again, with other noise and other
pixels. *Covered* is the share of runs whose 90 % interval holds the truth, with the standard error of that share;
*width* is the mean width of the interval beside the truth, *bias* that of the mean estimate. *By intercepts* is the
bias of the straight line through the 100 % intercepts: the usual way, which knows nothing of noise and bandwidth.
*One threshold* is the share of runs in which the test (at 1 %) finds that the threshold changes with the light; in
truth it never does.

| sensor | runs | covered | width | bias | by intercepts | one threshold denied | seconds a run |
|---|---|---|---|---|---|---|---|
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
    covered = float(np.mean((low <= true) & (true <= high)))
    error = math.sqrt(max(covered * (1.0 - covered), 0.25 / len(records)) / len(records))
    readings = np.array([r["by_intercept"] if r["by_intercept"] is not None else math.nan for r in records])
    denied = np.mean([r.get("constant_p", 1.0) < 0.01 for r in records])
    seconds = float(np.mean([r["seconds"] for r in records]))
    cells = (
        name, f"{len(records)}", f"{covered:.0%} +- {error:.0%}", f"{np.mean(high - low) / true:.1%}",
        f"{np.mean(value) / true - 1.0:+.1%}", f"{np.nanmean(readings) / true - 1.0:+.0%}", f"{denied:.0%}",
        f"{seconds:.1f}",
    )  # fmt: skip
    return f"| {' | '.join(cells)} |"
