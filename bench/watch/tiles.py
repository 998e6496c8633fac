"""The points of a run as small squares: one row for each light level of each measurement."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bench.watch.wording import look_text, point_lines, row_text

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from bench.watch.counting import PointCounts
    from bench.watch.history import History, PointHistory, PointState
    from bench.watch.planned import PlannedLook

__all__ = ["is_live", "is_over", "tile_groups", "tile_state"]

_Row = tuple[float, str]  # light level and polarity


def is_over(history: History) -> bool:
    """Return whether the run came to its end, in whatever way."""
    return history.state in ("finished", "aborted", "failed")


def is_live(history: History, written: bool | None) -> bool:
    """Return whether points are being taken, or will be when a pause is over, as far as one can know."""
    return not is_over(history) and written is not False


def tile_state(point: PointHistory, live: bool) -> PointState:
    """Return the state that a point is shown in: nothing is measured in a run that nobody writes."""
    return "planned" if point.state == "measuring" and not live else point.state


def tile_groups(
    history: History, planned: Mapping[int, PlannedLook], counts: Mapping[int, PointCounts], live: bool
) -> list[dict[str, Any]]:
    """Return the groups of squares: measurements, each with its rows, in the order of the plan.

    Within a row contrast grows. Points of which the plan does not know more than the number stand in one row.

    Parameters
    ----------
    history
        What the journal says.
    planned
        What the plan says, as far as it is known.
    counts
        What was measured, as far as it was counted.
    live
        Whether the run is being written.
    """
    names: dict[str, list[int]] = {}
    for index in history.points:
        names.setdefault(planned[index].measurement if index in planned else "", []).append(index)

    def row(label: str, members: Sequence[int]) -> dict[str, Any]:
        points = [history.points[index] for index in members]
        return {
            "label": label,
            "index": list(members),
            "state": [tile_state(point, live) for point in points],
            "attempt": [point.attempt for point in points],
            "about": [look_text(planned[index]) if index in planned else "" for index in members],
            "result": [point_lines(counts[index]) if index in counts else [] for index in members],
        }

    return [
        {"title": name or "points", "rows": [row(label, mine) for label, mine in _rows(members, planned)]}
        for name, members in names.items()
    ]


def _rows(members: Sequence[int], planned: Mapping[int, PlannedLook]) -> list[tuple[str, list[int]]]:
    """Return label and points of each row of a measurement: a row for each level, or one where each has one point."""
    if members[0] not in planned:
        return [("", list(members))]
    rows: dict[_Row, list[int]] = {}
    for index in members:
        look = planned[index]
        rows.setdefault((look.baseline_lux, look.polarity), []).append(index)
    if max(len(mine) for mine in rows.values()) == 1:
        return [("", [rows[row][0] for row in sorted(rows)])]
    several = len({polarity for _, polarity in rows}) > 1
    return [
        (
            row_text(lux, polarity if several else ""),
            sorted(rows[lux, polarity], key=lambda index: (planned[index].log_contrast, index)),
        )
        for lux, polarity in sorted(rows)
    ]
