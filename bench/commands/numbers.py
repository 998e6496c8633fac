"""Numbers on the command line: finite, and in their range."""

from __future__ import annotations

import math
from typing import Any

import click

__all__ = ["ABOVE_0", "FRACTION", "FROM_0"]


class _Number(click.FloatRange):
    """A number in a range; ``nan`` and ``inf``, which click lets through, are none."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        number: float = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"expected a finite number, found {value!r}", param, ctx)
        return number


ABOVE_0 = _Number(0.0, min_open=True)
FROM_0 = _Number(0.0)
FRACTION = _Number(0.0, 1.0, min_open=True)
