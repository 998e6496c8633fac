"""Events that go with a ripple which is not the stimulus."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from bench.diagnosis.views.base import Statistic, View

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.diagnosis.recorded.recording import Recording
    from bench.diagnosis.views.base import Part

__all__ = ["Locked", "LockedAcross"]

_PARTS: Final[tuple[Part, Part]] = ("off", "on")


class Locked(View):
    """Amplitude with which the rate of events goes with the ripple of a run, at the phase that the run has.

    It is that of events beyond what comes with the stimulus. Without a ripple in the run there is nothing to be said.
    """

    id: ClassVar[str] = "locked"
    title: ClassVar[str] = "rate of events locked to a ripple, Hz"
    unit: ClassVar[str] = "Hz"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield the amplitude of each polarity."""
        yield from _amplitudes(recording, 0.0)


class LockedAcross(View):
    """The same a quarter of a turn from the phase that the run has: none in the run, so that its phase is seen."""

    id: ClassVar[str] = "locked_across"
    title: ClassVar[str] = "rate of events locked to a ripple at another phase, Hz"
    unit: ClassVar[str] = "Hz"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield the amplitude of each polarity."""
        yield from _amplitudes(recording, 0.5 * math.pi)


def _amplitudes(recording: Recording, later_rad: float) -> Iterator[Statistic]:
    lock = recording.frame.lock
    if lock is None:
        return
    seconds = np.full(recording.pixels, lock.seconds)
    least = 1.0 / (recording.frame.pixels * lock.seconds)
    for polarity, part in enumerate(_PARTS):
        mine = recording.p == polarity
        phase = float(recording.frame.point.attributes[f"ripple_{part}_rad"]) + later_rad
        along = np.real(lock.of(recording.t_us[mine]) * np.exp(-1j * phase))
        top = np.bincount(recording.pixel[mine], weights=along, minlength=recording.pixels).astype(np.float64)
        yield Statistic(part, "difference", top, seconds, least=least)
