"""Whether the stimulus lies where it should on the time axis of the events: triggers, and what stands in for them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from bench.run.verdict_case import amber, red

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.run.verdict_case import Case, Found

__all__ = ["doubtful_time", "swapped_triggers", "triggers"]

#: Fewer triggers than this with a direction do not tell whether they are swapped.
_FEWEST: Final = 4
_MOST_RIGHT: Final = 0.1  #: of swapped triggers


def triggers(case: Case) -> Iterator[Found]:
    """Yield that triggers are missing, or that there are some that belong to nothing."""
    if not case.edges:
        return
    if case.record.stimulus.trigger is None:
        yield from _no_alignment(case)
        return
    lost = int((case.record.stimulus.trigger[1:] < 0).sum())
    extra = int(case.record.quality.get("triggers_without_edge", 0))
    most = case.limits.triggers_wrong * case.edges
    if lost > most:
        text = f"{lost} of {case.edges} edges of the light have no trigger"
        yield red(text) if lost > case.limits.triggers_wrong_again * case.edges else amber(text)
    if extra > most:
        yield amber(f"{extra} triggers belong to none of the {case.edges} edges of the light: is the wire disturbed?")


def _no_alignment(case: Case) -> Iterator[Found]:
    """Yield that the triggers say nothing of where the edges are."""
    came, axis = case.seen.n_triggers, case.record.attributes.get("time_axis")
    placed = axis not in (None, "edges_known", "trigger") and not case.record.quality.get("time_doubtful", 0)
    where = "placed by the events" if placed else "taken to be where the source says"
    if came:
        text = f"the {came} triggers do not fit the {case.edges} edges of the light, which are {where}"
        yield amber(text) if placed else red(text)
    elif case.limits.triggers_expected:
        text = f"no triggers came for {case.edges} edges of the light, which are {where}: is the wire in?"
        yield amber(text) if placed else red(text)
    elif case.limits.triggers_expected is None and not placed:
        yield amber(f"no triggers came for {case.edges} edges of the light, which are {where}")


def swapped_triggers(case: Case) -> Iterator[Found]:
    """Yield that rising triggers came where the light fell, and the other way round."""
    stimulus = case.record.stimulus
    if stimulus.trigger is None:
        return
    seen = case.seen.trigger_p
    change, trigger = np.diff(stimulus.lux), stimulus.trigger[1:]
    told = (trigger >= 0) & (trigger < len(seen)) & (change != 0.0)
    rising, up = seen[trigger[told]] == 1, change[told] > 0.0
    both = min(rising.sum(), (~rising).sum(), up.sum(), (~up).sum()) >= _FEWEST / 2
    if both and float((rising == up).mean()) <= _MOST_RIGHT:
        yield amber(
            f"the triggers are swapped: {int((rising != up).sum())} of {len(up)} rise where the light falls, or the "
            "other way round; their times are right (trigger_inverted of the camera turns them)"
        )


def doubtful_time(case: Case) -> Iterator[Found]:
    """Yield that it is not sure where the stimulus lies on the time axis of the events."""
    quality = case.record.quality
    if quality.get("time_doubtful", 0):
        note = str(quality.get("time_note", "")).strip()
        yield amber("the time axis is doubtful" + (f": {note}" if note else ""))
