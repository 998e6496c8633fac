"""What to measure: protocol files, the points they expand into, and the light of each point.

The names below are loaded when they are first used, so that importing this package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from protocols.errors import InputError, Problem
    from protocols.estimation import Estimate
    from protocols.expected import Expected
    from protocols.loading import LoadedProtocol, load_protocol, parse_protocol
    from protocols.points import Point
    from protocols.schema import Protocol
    from protocols.stimulus import Stimulus
    from protocols.waveforms import stimulus_of

__all__ = [
    "Estimate",
    "Expected",
    "InputError",
    "LoadedProtocol",
    "Point",
    "Problem",
    "Protocol",
    "Stimulus",
    "load_protocol",
    "parse_protocol",
    "stimulus_of",
]

_HOME = {
    "Estimate": "protocols.estimation",
    "Expected": "protocols.expected",
    "InputError": "protocols.errors",
    "LoadedProtocol": "protocols.loading",
    "Point": "protocols.points",
    "Problem": "protocols.errors",
    "Protocol": "protocols.schema",
    "Stimulus": "protocols.stimulus",
    "load_protocol": "protocols.loading",
    "parse_protocol": "protocols.loading",
    "stimulus_of": "protocols.waveforms",
}


def __getattr__(name: str) -> Any:
    """Load a public name from the module that defines it."""
    if name not in _HOME:
        raise AttributeError(f"module 'protocols' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
