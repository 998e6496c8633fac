"""The beginnings of long recordings, and the middle of large windows: as much of each as says enough.

A night on many pixels leaves more events than a diagnosis can simulate over and over. What pixels have of their own
is soon known: after some pulses each further one tells hardly anything. So recordings are looked at up to a time that
leaves all of them together with about so many events, dim ones as a whole. A recording that ends sooner is a
recording: what a model lets expect of it holds to the letter, whatever the effect.

The middle of a window is as good for all that pixels do by themselves, or to their neighbours. Limits of a readout,
which all pixels share, do not show in a part of them, and are not looked for there.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.windows import kept_pulses
from protocols.points import Roi

if TYPE_CHECKING:
    from collections.abc import Hashable, Sequence

    import numpy.typing as npt

    from bench.store.data import PointData

__all__ = ["ENOUGH_EVENTS", "beginnings", "middles", "shortened_text"]

#: Events of all points that are enough.
ENOUGH_EVENTS: Final = 2_000_000
#: No recording has fewer pulses of a kind and contrast left, or is shorter than this, s.
_LEAST_PULSES: Final = 8
_LEAST_S: Final = 2.0
#: Of a window no more than so many pixels on a side are looked at: more sharpen nothing that the pulses do not.
_MOST_SIDE: Final = 64
_MOST_PIXELS: Final = _MOST_SIDE**2
#: A recording of which more than this share is wanted stays whole.
_NEARLY_ALL: Final = 0.9


def beginnings(points: Sequence[PointData], enough: int = ENOUGH_EVENTS) -> list[PointData]:
    """Return the points; those with more events than their share of what is enough end after a whole pulse.

    Parameters
    ----------
    enough
        Events of all points together; there may be more where few pulses have more.
    """
    usual = _usual_events(points)
    most = _level(usual, enough)
    return [_ended(p, p.duration_s * most / n) if n > most else p for p, n in zip(points, usual, strict=True)]


def middles(points: Sequence[PointData]) -> list[PointData]:
    """Return the points; those with large windows with the middle of them."""
    return [_middle(p) if p.roi.pixels > _MOST_PIXELS else p for p in points]


def _middle(point: PointData) -> PointData:
    """Return a point with as many pixels from the middle of its window as are enough."""
    roi = point.roi
    width = min(roi.width, max(_MOST_SIDE, _MOST_PIXELS // roi.height))
    height = min(roi.height, _MOST_PIXELS // width)
    x, y = roi.x + (roi.width - width) // 2, roi.y + (roi.height - height) // 2
    mx, my = point.masked[:, 0], point.masked[:, 1]
    masked = point.masked[(mx >= x) & (mx < x + width) & (my >= y) & (my < y + height)]
    return replace(
        point,
        roi=Roi(x, y, width, height),
        stored_roi=roi,
        masked=masked,
        n_events=round(point.n_events * width * height / roi.pixels),  # about
    )


def shortened_text(whole: Sequence[PointData], looked_at: Sequence[PointData]) -> str:
    """Return how much of the recordings is looked at; nothing where it is all."""
    found = [_window_text(whole, looked_at), _duration_text(whole, looked_at)]
    return "; ".join(text for text in found if text)


def _window_text(whole: Sequence[PointData], looked_at: Sequence[PointData]) -> str:
    part = [(a.roi, b.roi) for a, b in zip(whole, looked_at, strict=True) if a.roi != b.roi]
    if not part:
        return ""
    of, middle = part[0]
    return (
        f"{middle.width} x {middle.height} of {of.width} x {of.height} pixels, in the middle (limits of the "
        "whole readout do not show there)"
    )


def _duration_text(whole: Sequence[PointData], looked_at: Sequence[PointData]) -> str:
    cut = sum(b.duration_s < a.duration_s for a, b in zip(whole, looked_at, strict=True))
    if not cut:
        return ""
    before, after = (sum(p.pulse_start_s.size for p in some) for some in (whole, looked_at))
    seconds = [sum(p.duration_s for p in some) for some in (whole, looked_at)]
    pulses = f"{after} of {before} test pulses, " if before else ""
    return f"the beginning of {cut} of {len(whole)} recordings: {pulses}{seconds[1]:.0f} of {seconds[0]:.0f} s"


def _usual_events(points: Sequence[PointData]) -> list[float]:
    """Return for each point how many events those have, on average, of which the same was asked, at any light.

    They are to be equally long: what the light is hardly matters to a base pixel, so they are simulated as one.
    """
    asked: dict[Hashable, list[int]] = {}
    keys = [_asked(p) for p in points]
    for key, point in zip(keys, points, strict=True):
        asked.setdefault(key, []).append(point.n_events)
    return [sum(asked[key]) / len(asked[key]) for key in keys]


def _asked(point: PointData) -> Hashable:
    times = np.round([point.pulse_start_s, point.pulse_stop_s], 6)
    return point.waveform, point.polarity, round(point.duration_s, 6), round(point.log_contrast, 6), times.tobytes()


def _level(events: Sequence[float], enough: int) -> float:
    """Return up to how many events each point has, so that all have no more than are enough."""
    left = float(enough)
    ordered = sorted(events)
    for i, n in enumerate(ordered):
        if n * (len(ordered) - i) > left:
            return left / (len(ordered) - i)
        left -= n
    return math.inf


def _ended(point: PointData, wanted_s: float) -> PointData:
    """Return a point that ends about then, behind a pulse; it is whole where that is nearly all of it."""
    end_s = _end_of_pulse(point, wanted_s) if point.pulse_start_s.size else max(wanted_s, _LEAST_S)
    if end_s > _NEARLY_ALL * point.duration_s:
        return point
    lit = point.stimulus_t_s < end_s
    pulses = point.pulse_stop_s <= end_s + 1e-9
    gaps = point.gaps_s[point.gaps_s[:, 0] < end_s]
    triggers = point.triggers_t_us < end_s * 1e6
    return replace(
        point,
        duration_s=end_s,
        until_s=end_s,
        stimulus_t_s=point.stimulus_t_s[lit],
        stimulus_lux=point.stimulus_lux[lit],
        pulse_start_s=point.pulse_start_s[pulses],
        pulse_stop_s=point.pulse_stop_s[pulses],
        pulse_kind=point.pulse_kind[pulses],
        pulse_valid=point.pulse_valid[pulses],
        pulse_log_contrast=point.pulse_log_contrast[pulses],
        triggers_t_us=point.triggers_t_us[triggers],
        triggers_p=point.triggers_p[triggers],
        gaps_s=np.minimum(gaps, end_s),
    )


def _end_of_pulse(point: PointData, wanted_s: float) -> float:
    """Return the end of the first pulse that ends then or later, with enough of each kind before it."""
    stops = _stops(point)
    least = max((mine[min(_LEAST_PULSES, mine.size) - 1] for mine in stops), default=point.duration_s)
    later = [float(stop) for mine in stops for stop in mine if stop >= max(wanted_s, least)]
    return min(later, default=point.duration_s)


def _stops(point: PointData) -> list[npt.NDArray[np.float64]]:
    """Return when the pulses of each kind and contrast end, of those that count."""
    kept = kept_pulses(point)
    kinds = np.stack([point.pulse_kind[kept].astype(np.float64), np.round(point.pulse_log_contrast[kept], 9)], axis=1)
    _, which = np.unique(kinds, axis=0, return_inverse=True)
    return [point.pulse_stop_s[kept][which.ravel() == k] for k in range(int(which.max(initial=-1)) + 1)]
