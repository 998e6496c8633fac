"""From the events of a run to S-curves, thresholds, background rates and maps.

:func:`analyze` is all that the rest of the bench needs; what it returns stands in :mod:`bench.analysis.results`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.analysis.results import (
    Analysis,
    BackgroundRow,
    CurveKey,
    Estimate,
    PixelMap,
    ResponseRow,
    SCurve,
)

if TYPE_CHECKING:
    from bench.analysis.whole import RunLike, analyze

__all__ = [
    "Analysis",
    "BackgroundRow",
    "CurveKey",
    "Estimate",
    "PixelMap",
    "ResponseRow",
    "RunLike",
    "SCurve",
    "analyze",
]


def __getattr__(name: str) -> object:
    """Load the analysis itself when it is asked for: the results alone need no numpy."""
    if name in ("analyze", "RunLike"):
        from bench.analysis import whole

        return getattr(whole, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
