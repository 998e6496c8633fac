"""What to measure next, where the data cannot tell effects apart."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from protocols import load_protocol

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["next_measurement"]

_LIGHT: Final = frozenset({"dark_current", "stray_light"})
_SLOW: Final = frozenset(
    {"photoreceptor_bandwidth", "source_follower_bandwidth", "light_rise_time", "comparator_delay"}
)
_DRIFTING: Final = frozenset({"leak", "parasitic_photocurrent", "light_drift", "hot_pixels", "low_frequency_noise"})
_NOISY: Final = frozenset({"shot_noise", "low_frequency_noise", "light_flicker", "reset_noise", "threshold_mismatch"})

#: Effects of which two are told apart by a protocol of ours, and how; the first line that fits counts.
_APART: Final[tuple[tuple[frozenset[str], str, str], ...]] = (
    (_LIGHT, "on_family", "the dim S-curves again under a shroud, where there is no stray light (on_family)"),
    (_LIGHT | _SLOW, "pulse_width", "the response against pulse width (pulse_width)"),
    (_DRIFTING, "background_activity", "background activity from darkness to bright light (background_activity)"),
    (_NOISY, "background_activity", "background activity from darkness to bright light (background_activity)"),
)


def next_measurement(ties: Mapping[str, Sequence[str]]) -> dict[str, Any] | None:
    """Return the protocol that tells effects apart which a diagnosis cannot, and the minutes it takes.

    None where nothing is tied, or where no protocol of ours is known to help.
    """
    for name, tied in ties.items():
        group = frozenset({name, *tied})
        for apart, protocol, title in _APART:
            if group <= apart:
                estimate = load_protocol(protocol).protocol.estimate()
                return {
                    "protocol": protocol,
                    "title": title,
                    "separates": [name, *tied],
                    "minutes": round(estimate.duration_s / 60.0, 1),
                }
    return None
