"""From where on something is worth a word, and from where on a point should be taken again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bench.run.verdict_seen import Seen

__all__ = ["Limits"]


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a verdict. Those named ``_again`` make it red, the others amber."""

    lost_again: float = 0.02  #: share of the recording that is missing, as where a diagnosis refuses it
    windows_lost_again: float = 0.05  #: share of the response windows that something is missing from
    decode_errors_again: float = 0.01  #: share of the events that broke the rules of their format
    invalid_pulses: float = 0.01  #: share of the pulses that are marked as not valid
    invalid_pulses_again: float = 0.1
    triggers_wrong: float = 0.01  #: share of the edges without a trigger, or of triggers without an edge
    triggers_wrong_again: float = 0.5  #: with fewer triggers than this there is no alignment by them
    triggers_expected: bool | None = None  #: whether a trigger wire is there; None where that is not known
    level_changed: float = 0.02  #: between the light before and after the point
    level_changed_again: float = 0.1
    temperature_changed_c: float = 2.0  #: during the point, degrees Celsius
    max_rate_eps: float = 1e8  #: 16-bit words in the 1.6 Gbit/s that the maker states for the EVK3
    max_bytes_per_s: float = 2e8  #: the same in bytes
    near_limit: float = 0.9  #: share of either
    dead_time_limited: float = 0.8  #: share of the events that the dead time lets a pixel give
    stuck_share: float = 0.05  #: share of the events that comes from a few pixels
    outside_share: float = 0.001  #: share of the events that comes from outside the window
    drift_p: float = 1e-6  #: probability of so large a difference by chance, all looks together
    drift_share: float = 0.05  #: difference of the halves, of the larger; less is of no importance
    drift_share_again: float = 0.5
    strong_step: float = 2.0  #: thresholds that a step must have to be answered for sure
    highest_threshold: float = 1.0  #: ln; where the settings do not say: no sensor is set higher
    dark_light_lux: float | None = None  #: as believed; None: as much as `most_dark_light_lux`
    most_dark_light_lux: float = 1.0  #: no sensor has more
    silent_below: float = 0.05  #: answers per pixel and strong step

    def learned(self, seen: Seen, edges: int) -> Limits:
        """Return these limits, with a trigger wire from now on if triggers came for the edges of a point."""
        return replace(self, triggers_expected=True) if edges and seen.n_triggers >= edges / 2 else self
