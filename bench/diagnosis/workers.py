"""Who simulates for a comparison or a diagnosis: processes that know the user's own effects and views."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from bench.compute import Workforce
from bench.diagnosis.views.registry import same_views
from bench.models.effect_sources import same_effects

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

__all__ = ["processes"]


def processes(workers: int) -> Workforce:
    """Return so many processes, which know the user's own effects and views; 1 is this process."""
    known = [setup for setup in (same_effects(), same_views()) if setup is not None]
    return Workforce(workers, setup=partial(_each, known) if known else None)


def _each(setups: Sequence[Callable[[], object]]) -> None:
    for setup in setups:
        setup()
