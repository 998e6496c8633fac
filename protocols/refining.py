"""The points that may be added to curves while they are taken.

A curve is one combination of all axes but the contrast. Points that are added to it are taken right after those that
were planned, so that filter and settings stay. Their numbers come after those of all planned points, and each curve
has numbers of its own: which number, and which seed, a point gets does not depend on what other curves need, nor on
who takes them in which order. Numbers that are not needed stay free. A seed does not depend on how many may be added.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from protocols.expansion import expand, in_order, seed_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from protocols.points import Point
    from protocols.refine import Refine
    from protocols.schema import Measurement, Protocol

__all__ = ["RefinedCurve", "refined_curves", "worst_case"]


@dataclass(frozen=True, slots=True)
class RefinedCurve:
    """A curve to which points may be added."""

    refine: Refine
    planned: tuple[Point, ...]  #: taken first, in this order
    spare: tuple[Point, ...]  #: what may be added; their contrast is that of a point of the middle
    shuffled: bool  #: whether contrasts are taken in the order of the seeds

    @property
    def number(self) -> int:
        """What the curve is known by: the number of the first point that may be added."""
        return self.spare[0].index


def refined_curves(protocol: Protocol) -> tuple[RefinedCurve, ...]:
    """Return the curves of `protocol` to which points may be added, in the order in which they are taken."""
    refined = {m.name: m for m in protocol.measurements if _refine(m) is not None}
    if not refined:
        return ()
    written = in_order(protocol)
    curves: list[RefinedCurve] = []
    first = len(written)
    for measurement, which, planned in _planned(refined, written):
        curve = _curve(protocol, measurement, which, planned, first)
        first += len(curve.spare)
        curves.append(curve)
    return tuple(curves)


def worst_case(protocol: Protocol) -> tuple[Point, ...]:
    """Return the points of `protocol` as they are taken if all are added that may be.

    The contrast of those that are added is that of a point of the middle; all else of them is as it will be.
    """
    after = {curve.planned[-1].index: curve.spare for curve in refined_curves(protocol)}
    points = expand(protocol)
    return tuple(one for point in points for one in (point, *after.get(point.index, ()))) if after else points


def _planned(
    refined: dict[str, Measurement], written: Sequence[Point]
) -> Iterator[tuple[Measurement, int, tuple[Point, ...]]]:
    """Yield measurement, place within it as written, and planned points of each curve, the first taken first.

    Parameters
    ----------
    refined
        The measurements, by name.
    written
        All points in the order in which they are taken; `index` counts within the measurement.
    """
    found: dict[tuple[str, int], list[Point]] = {}
    for index, point in enumerate(written):
        if point.measurement in refined:
            which = point.index // _contrasts(refined[point.measurement])
            found.setdefault((point.measurement, which), []).append(replace(point, index=index))
    for (name, which), points in found.items():
        yield refined[name], which, tuple(points)


def _curve(
    protocol: Protocol, measurement: Measurement, which: int, planned: tuple[Point, ...], first: int
) -> RefinedCurve:
    refine = _refine(measurement)
    if refine is None:
        raise ValueError(f"{measurement.name} is not refined")
    middle = sorted(planned, key=lambda point: point.log_contrast)[len(planned) // 2]
    spare = tuple(
        replace(middle, index=first + i, seed=seed_of(protocol, measurement, f"{which}+{i}"), operator_before=None)
        for i in range(refine.at_most)
    )
    return RefinedCurve(refine, planned, spare, protocol.order == "shuffled")


def _refine(measurement: Measurement) -> Refine | None:
    contrast = measurement.sweep.contrast
    return None if contrast is None else contrast.refine


def _contrasts(measurement: Measurement) -> int:
    contrast = measurement.sweep.contrast
    return 1 if contrast is None else len(contrast.numbers())
