"""Where the variants of a grid lie."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from bench.study.schema import Grid

__all__ = ["places"]


def places(axes: Mapping[str, Sequence[float]], grid: Grid) -> list[dict[str, float]]:
    """Return the places of a grid: every combination of its axes, or one axis at a time.

    Parameters
    ----------
    axes
        Values of each axis that are wanted.
    grid
        Says which of the two it is.
    """
    if not grid.one_at_a_time:
        return [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]
    return [{name: value} for name, values in axes.items() for value in values]
