"""Whether a point was the same from its beginning to its end."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.run.verdict_case import amber, red

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from bench.run.verdict_case import Case, Found

__all__ = ["changed_level", "changed_temperature", "drift", "flash"]

_FEWEST: Final = 8  #: counts in a row
_BINS: Final = 64  #: of constant light
#: Left out of constant light and square waves: both begin with more events than what lasts. Before reset and test
#: pulses it is one period.
_FIRST: Final = 0.25
_KINDS: Final = ((0, "step up"), (1, "step down"))
_POLARITIES: Final = ((0, "OFF"), (1, "ON"))
_FLASH_S: Final = 0.05
_FLASH_PER_PIXEL: Final = 0.3  #: events in such a time, above the usual
_FLASH_TIMES: Final = 3.0  #: the usual
_FLASH_SDS: Final = 10.0  #: above the usual
_FLASH_NEAR: Final = 10  #: such times before and after


@dataclass(frozen=True, slots=True)
class _Row:
    """Counts of the same thing, again and again through a point."""

    what: str
    counts: npt.NDArray[np.float64]


def drift(case: Case) -> Iterator[Found]:
    """Yield the clearest difference between the first and the second half of a point, if one is beyond chance."""
    rows = [row for row in _rows(case) if len(row.counts) >= _FEWEST]
    found = []
    for row in rows:
        first, second, p = _halves(row.counts)
        share = abs(first - second) / max(first, second, 1e-12)
        if p * len(rows) < case.limits.drift_p and share > case.limits.drift_share:
            found.append((share, row.what, first / case.roi.pixels, second / case.roi.pixels))
    if found:
        share, what, first, second = max(found)
        change = f"{100.0 * (second / first - 1.0):+.0f} %" if first > 0.0 else "none before"
        text = f"drift: {what}: {first:.3g} per pixel in the first half, {second:.3g} in the second ({change})"
        yield red(text) if case.pulses and share > case.limits.drift_share_again else amber(text)


def _rows(case: Case) -> Iterator[_Row]:
    if not case.pulses:
        yield from _rows_of_constant(case)
        return
    pulses, square = case.record.pulses, case.record.waveform == "square"
    for kind, step in _KINDS:
        mine = pulses.kind == kind
        start, stop = pulses.start_s[mine], pulses.stop_s[mine]
        if len(start) < _FEWEST:
            continue
        first = math.ceil(_FIRST * len(start)) if square else 1
        start, stop = start[first:], stop[first:]
        name = "ON" if kind == 0 else "OFF"
        yield _Row(f"{name} answers to a {step}", case.seen.between(start, stop)[1 - kind])
        periods = case.seen.between(start[:-1], start[1:])
        for polarity, name in _POLARITIES:
            yield _Row(f"{name} events in a period", periods[polarity])


def _rows_of_constant(case: Case) -> Iterator[_Row]:
    limits_s = np.linspace(_FIRST, 1.0, _BINS + 1) * case.record.duration_s
    counted = case.seen.between(limits_s[:-1], limits_s[1:])
    length = f"{limits_s[1] - limits_s[0]:.2g} s"
    for polarity, name in _POLARITIES:
        yield _Row(f"{name} events in {length} of constant light", counted[polarity])


def _halves(counts: npt.NDArray[np.float64]) -> tuple[float, float, float]:
    """Return the mean of both halves, and how likely so large a difference is by chance.

    How much the counts scatter is seen from one to the next, so that a drift does not count as scatter; they scatter
    as events that come independently of each other at least. The scatter of n counts so found has about 2n/3 degrees
    of freedom (J. von Neumann et al., 1941).
    """
    from scipy.special import stdtr

    n = len(counts) // 2
    first, second = counts[:n], counts[-n:]
    total = float(first.sum() + second.sum())
    if total == 0.0:
        return 0.0, 0.0, 1.0
    variance = max(float(np.square(np.diff(counts)).mean()) / 2.0, total / (2 * n))
    t = abs(float(first.mean() - second.mean())) / math.sqrt(variance * 2.0 / n)
    return float(first.mean()), float(second.mean()), 2.0 * float(stdtr(2.0 * len(counts) / 3.0, -t))


def flash(case: Case) -> Iterator[Found]:
    """Yield that many pixels fired at once in constant light: the light or the room changed."""
    if case.pulses or case.edges:
        return
    limits_s = np.arange(0.0, case.record.duration_s, _FLASH_S)
    if len(limits_s) <= _FEWEST:
        return
    counted = case.seen.between(limits_s[:-1], limits_s[1:])
    for polarity, name in _POLARITIES:
        row = counted[polarity]
        place = int(row.argmax())
        near = row[max(0, place - _FLASH_NEAR) : place + _FLASH_NEAR + 1]  # there are more events at the beginning
        usual = float(max(np.median(row), np.median(near)))
        scatter = max(1.4826 * float(np.median(np.abs(row - usual))), math.sqrt(usual), 1.0)
        above = row[place] - usual
        enough = above >= max(_FLASH_PER_PIXEL * case.roi.pixels, _FLASH_SDS * scatter)
        if enough and row[place] >= _FLASH_TIMES * usual:
            yield amber(
                f"the light changed: at {limits_s[place]:.3g} s {row[place]:.0f} {name} events came within "
                f"{1e3 * _FLASH_S:.0f} ms of constant light, {usual:.3g} is usual"
            )


def changed_level(case: Case) -> Iterator[Found]:
    """Yield that the light was measured before and after the point, and is not the same."""
    before, after = (case.record.attributes.get(f"bench_lux_{when}") for when in ("before", "after"))
    if before is None or after is None or not max(before, after) > 0.0:
        return
    change = abs(after - before) / max(before, after)
    if change > case.limits.level_changed:
        text = f"the light changed from {before:.4g} lux before the point to {after:.4g} lux after it"
        yield red(text) if change > case.limits.level_changed_again else amber(text)


def changed_temperature(case: Case) -> Iterator[Found]:
    """Yield that the sensor became warmer or colder, where its temperature was read before and after."""
    before, after = case.record.attributes.get("temperature_before_c"), case.record.temperature_c
    if before is not None and abs(after - before) > case.limits.temperature_changed_c:
        yield amber(f"the sensor went from {before:.1f} to {after:.1f} degrees Celsius during the point")
