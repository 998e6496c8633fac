"""Stimulus and camera on one time axis: by trigger edges, or by the events that answer the edges of the light."""

from __future__ import annotations

from bench.alignment.counts import EventCounts
from bench.alignment.events import EdgeAlignment, align_to_events
from bench.alignment.latency import Answering
from bench.alignment.triggers import Alignment, align_to_triggers, moved_windows

__all__ = [
    "Alignment",
    "Answering",
    "EdgeAlignment",
    "EventCounts",
    "align_to_events",
    "align_to_triggers",
    "moved_windows",
]
