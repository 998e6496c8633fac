"""The views that there are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from bench.diagnosis.views.array import Burst, Neighbours, Outliers
from bench.diagnosis.views.background import (
    Background,
    BackgroundHalves,
    BackgroundSpread,
    Intervals,
    Regularity,
    SamePolarity,
)
from bench.diagnosis.views.latency import Latency, LatencySpread, SecondEvent
from bench.diagnosis.views.locked import Locked
from bench.diagnosis.views.response import ExtraEvents, OtherPolarity, Response
from bench.diagnosis.views.scatter import CommonMode, Halves, PixelSpread, Succession

if TYPE_CHECKING:
    from bench.diagnosis.views.base import View

__all__ = ["VIEWS"]

VIEWS: Final[tuple[View, ...]] = (
    Response(),
    ExtraEvents(),
    OtherPolarity(),
    Latency(),
    LatencySpread(),
    SecondEvent(),
    PixelSpread(),
    Succession(),
    Halves(),
    CommonMode(),
    Background(),
    BackgroundHalves(),
    BackgroundSpread(),
    SamePolarity(),
    Intervals(),
    Regularity(),
    Neighbours(),
    Outliers(),
    Burst(),
    Locked(),
)
