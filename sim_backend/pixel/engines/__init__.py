"""Engines: chain + stimulus + seed -> events."""

from __future__ import annotations

from sim_backend.pixel.engines.base import Engine
from sim_backend.pixel.engines.fast import FastEngine
from sim_backend.pixel.engines.reference import ReferenceEngine

__all__ = ["Engine", "FastEngine", "ReferenceEngine"]
