"""Waveforms for the tests of the LED driver."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from drivers.interfaces import Waveform

if TYPE_CHECKING:
    from collections.abc import Sequence


def waveform(t_us: Sequence[float], level: Sequence[float], duration_us: float) -> Waveform:
    return Waveform(np.array(t_us, dtype=np.float64) / 1e6, np.array(level, dtype=np.float64), duration_us / 1e6)
