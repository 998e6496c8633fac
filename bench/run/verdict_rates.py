"""Whether something other than the pixels' answers ruled the events: readout, dead time, pixels out of order."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.run.verdict_case import amber, share_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from bench.run.verdict_case import Case, Found

__all__ = ["dead_time", "outside", "rate_at_limit", "rate_plateau", "stuck_pixels"]

_MS_US: Final = 1000
_PLATEAU_MS: Final = 16  #: shorter ones are answers that all pixels give at once
_PLATEAU_EVENTS: Final = 100  #: per ms; with fewer, chance makes plateaus
_PLATEAU_DISPERSION: Final = 0.05  #: variance of counts beside that of independent events
_PLATEAU_TOP: Final = 0.9  #: of the highest rate of the recording
_DEAD_TIMES: Final = 3.0  #: a window must have for its events to be counted against it
_STUCK_EVENTS: Final = 50
_STUCK_TIMES: Final = 10.0  #: what three of four pixels stay below
_FEWEST_PIXELS: Final = 9  #: to say what is usual
_IMPOSSIBLE: Final = 1.5  #: times as often as the dead time allows
_SHOWN: Final = 3


def rate_at_limit(case: Case) -> Iterator[Found]:
    """Yield that the rate came near what can be transferred."""
    limits, duration_s = case.limits, case.record.duration_s
    bin_s = case.seen.bin_us / 1e6
    highest = float(case.seen.binned(duration_s).sum(axis=0).max(initial=0)) / bin_s
    if highest >= limits.near_limit * limits.max_rate_eps:
        yield amber(f"the rate reached {highest:.3g} events/s; the camera transfers about {limits.max_rate_eps:.3g}")
    bytes_per_s = case.record.quality.get("bytes_received", 0) / duration_s
    if bytes_per_s >= limits.near_limit * limits.max_bytes_per_s:
        yield amber(f"{bytes_per_s:.3g} bytes/s came; the camera transfers {limits.max_bytes_per_s:.3g} at most")


def rate_plateau(case: Case) -> Iterator[Found]:
    """Yield that the rate stood at a ceiling: events that come by themselves scatter, those that wait do not."""
    counts = case.seen.binned(case.record.duration_s).sum(axis=0).astype(np.float64)
    n = _PLATEAU_MS
    if case.seen.bin_us != _MS_US or len(counts) < n:
        return
    sums, squares = (np.cumsum(np.append(0.0, values)) for values in (counts, np.square(counts)))
    mean = (sums[n:] - sums[:-n]) / n
    variance = np.maximum((squares[n:] - squares[:-n]) / n - np.square(mean), 0.0) * n / (n - 1)
    ceiling = (mean >= max(_PLATEAU_EVENTS, _PLATEAU_TOP * counts.max())) & (variance <= _PLATEAU_DISPERSION * mean)
    ceiling &= ~_is_dead_time(case, mean * 1000.0)
    if ceiling.any():
        first = int(ceiling.argmax())
        yield amber(
            f"the readout was the limit: {1000 * mean[first]:.3g} events/s without scatter for {n} ms and more, "
            f"first at {first / 1000:.3g} s"
        )


def _is_dead_time(case: Case, rate_eps: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Return where a rate is what pixels give that fire whenever they can."""
    dead_s = case.record.refractory_s
    if not math.isfinite(dead_s) or dead_s <= 0.0:
        return np.zeros(len(rate_eps), bool)
    return np.asarray(rate_eps >= 0.7 * case.roi.pixels / dead_s)


def dead_time(case: Case) -> Iterator[Found]:
    """Yield that pixels fired again as soon as their dead time was over: more light would not have been seen."""
    dead_s, record = case.record.refractory_s, case.record
    if not math.isfinite(dead_s) or dead_s <= 0.0:
        return
    start, stop = record.pulses.start_s, record.pulses.stop_s
    if not case.pulses:
        start, stop = np.zeros(1), np.array([record.duration_s])
    length_s = float((stop - start).mean())
    if length_s < _DEAD_TIMES * dead_s:
        return
    others = 1.0 - _stuck(case)[1]  # what pixels do that never stop says nothing of the others
    events = others * float(case.seen.between(start, stop).sum()) / (case.roi.pixels * len(start))
    share = events * dead_s / length_s
    if share >= case.limits.dead_time_limited:
        where = "response windows" if case.pulses else "constant light"
        yield amber(
            f"the dead time of {1e3 * dead_s:.3g} ms was the limit: {events / length_s:.3g} events/s per pixel in "
            f"{where}, {share_text(share)} of what it allows"
        )


def stuck_pixels(case: Case) -> Iterator[Found]:
    """Yield that a few pixels gave a large part of the events, or more than their dead time allows."""
    stuck, share = _stuck(case)
    if stuck.any() and share > case.limits.stuck_share:
        yield amber(_stuck_text(case, stuck, share))
    told = int(case.record.quality.get("hot_pixels", 0))
    if told and not stuck.any():
        yield amber(f"the camera reports {told} hot pixels")


def _stuck(case: Case) -> tuple[npt.NDArray[np.bool_], float]:
    """Return which pixels gave far more events than others, or than they can, and their share of all."""
    counts, record = case.seen.pixels, case.record
    limit = math.inf
    if counts.size >= _FEWEST_PIXELS:
        limit = _STUCK_TIMES * (float(np.percentile(counts, 75)) + 3.0)
    if math.isfinite(record.refractory_s) and record.refractory_s > 0.0:
        limit = min(limit, _IMPOSSIBLE * (record.duration_s / record.refractory_s + 1.0))
    stuck = counts > max(_STUCK_EVENTS, limit)
    return stuck, float(counts[stuck].sum()) / max(int(counts.sum()), 1)


def _stuck_text(case: Case, stuck: npt.NDArray[np.bool_], share: float) -> str:
    counts = np.where(stuck, case.seen.pixels, 0)
    worst = np.argsort(counts, axis=None)[::-1][: min(_SHOWN, int(stuck.sum()))]
    places = []
    for number in worst:
        row, column = divmod(int(number), counts.shape[1])
        rate = counts[row, column] / case.record.duration_s
        places.append(f"({case.roi.x + column}, {case.roi.y + row}) at {rate:.3g} events/s")
    number = int(stuck.sum())
    what = "1 pixel gave" if number == 1 else f"{number} pixels gave"
    more = ", ..." if number > len(places) else ""
    return f"{what} {share_text(share)} of the events: {', '.join(places)}{more}"


def outside(case: Case) -> Iterator[Found]:
    """Yield that events came from pixels that should be off."""
    count, total = case.seen.n_outside, case.seen.n_events
    if count > case.limits.outside_share * total:
        yield amber(f"{count} of {total} events came from outside the window")
