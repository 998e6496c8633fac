"""What is to be expected of a run, for people: time, size, what to do by hand, what the light cannot do exactly."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from bench.run.progress import duration_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from datetime import datetime

    from bench.catalogue.pace import Pace
    from bench.run.foresight import ByHand, Foresight
    from protocols.estimation import Estimate

__all__ = ["count_text", "foresight_lines", "points_text", "time_lines"]

#: So many changes by hand are told one by one.
_MOST_CHANGES: Final = 12
_MINUTE_S: Final = 60.0


def points_text(estimate: Estimate) -> str:
    """Return how many points there are: ``36 points``, ``at most 36 points (12 planned, 24 where curves rise)``."""
    points = count_text(estimate.points, "point")
    if not estimate.added:
        return points
    return f"at most {points} ({estimate.points - estimate.added} planned, {estimate.added} more where curves rise)"


def time_lines(estimate: Estimate, foresight: Foresight, end: datetime) -> Iterator[str]:
    """Yield how long it takes, and until when; that is the worst case where points may be added.

    Parameters
    ----------
    estimate
        What the protocol says.
    foresight
        What is known beside it.
    end
        When a run that starts now would be over by the clock of the station, local time.
    """
    takes, settling = duration_text(foresight.duration_s), f"{duration_text(estimate.settling_s)} of it to settle"
    takes = f"at most {takes}" if estimate.added else takes
    if foresight.real_clock:
        ends = "ends at the latest" if estimate.added else "ends"
        yield f"time: {takes} ({settling}); it {ends} {end:%Y-%m-%d %H:%M} if it starts now"
        yield from _learned(foresight.pace)
    else:
        yield f"time: {takes} on a bench ({settling}), there until {end:%Y-%m-%d %H:%M}"
        yield f"simulated station: {_computing(foresight, worst=estimate.added > 0)}"


def _computing(foresight: Foresight, *, worst: bool) -> str:
    if foresight.real_duration_s is None or foresight.real_end is None or foresight.pace is None:
        return "how long it computes is not known: no earlier run on it had recordings of this size"
    length = duration_text(max(1.0, foresight.real_duration_s))
    about = "about, at most," if worst else "about"
    return f"computes for {about} {length}, until {foresight.real_end:%H:%M} (from {_runs(foresight.pace)})"


def _learned(pace: Pace | None) -> Iterator[str]:
    if pace is None:
        return
    more = [("a change of the filter", pace.filter_s), ("a change of biases or window", pace.bias_s)]
    others = [f"{value:.2g} s with {what}" for what, value in more if value is not None]
    yield f"from {_runs(pace)}: {', '.join([f'{pace.plain_s:.2g} s beside each recording and its wait', *others])}"


def _runs(pace: Pace) -> str:
    return f"{count_text(pace.runs, 'earlier run')} on this station"


def foresight_lines(estimate: Estimate, foresight: Foresight) -> Iterator[str]:
    """Yield what else is to be expected: size, steps by hand, contrasts that cannot be set exactly."""
    yield _size(estimate, foresight)
    hand = foresight.changes_by_hand
    if hand:
        yield f"by hand: {count_text(len(hand), 'filter')} to put in: {_when(hand)}"
    for step in foresight.operator_steps[:_MOST_CHANGES]:
        yield f"by hand, minute {step.at_s / _MINUTE_S:.0f}: {step.what}"
    if foresight.contrast is not None:
        worst = foresight.contrast
        yield f"contrast: the worst is point {worst.point} of {worst.measurement}: {worst}"


def _size(estimate: Estimate, foresight: Foresight) -> str:
    size = f"size: at most about {_size_text(estimate.bytes)}"
    if foresight.free_bytes is None:
        return size
    free = f"{_size_text(foresight.free_bytes)} free on the disk of {foresight.folder}"
    return f"{size}; {'only ' if foresight.free_bytes < estimate.bytes else ''}{free}"


def _when(changes: Sequence[ByHand]) -> str:
    """Return what is put in and when: ``clear before it starts, nd10 at minute 12``."""
    told = [
        f"{one.what} {'before it starts' if one.at_s == 0.0 else f'at minute {one.at_s / _MINUTE_S:.0f}'}"
        for one in changes[:_MOST_CHANGES]
    ]
    rest = len(changes) - _MOST_CHANGES
    return ", ".join([*told, *([f"... the last at minute {changes[-1].at_s / _MINUTE_S:.0f}"] if rest > 0 else [])])


def count_text(number: int, what: str) -> str:
    """Return a number of things: ``1 point``, ``2 points``."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def _size_text(size: float) -> str:
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000.0:
            return f"{size:.3g} {unit}"
        size /= 1000.0
    return f"{size:.3g} TB"
