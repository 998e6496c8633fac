"""A short form of the soak: every place of a kill at least once, and an hour of a night with faults."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import pytest

from benchmarks.soak.kills import kill_and_resume
from benchmarks.soak.night import spend_a_night
from benchmarks.soak.places import PLACES

if TYPE_CHECKING:
    from pathlib import Path


def nobody(text: str) -> None:
    """Tell nobody."""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are forked")
def test_kills_at_every_place_lose_nothing(tmp_path: Path) -> None:
    found = kill_and_resume(tmp_path / "kills", 2 * len(PLACES), 3, nobody)
    assert found.problems == []
    assert dict(found.places) == dict.fromkeys(PLACES, 2)


@pytest.mark.slow
def test_an_hour_of_a_night_with_faults(tmp_path: Path) -> None:
    night = spend_a_night(tmp_path / "night", 1.0, 5, nobody)
    assert night.problems == []
    assert night.done + night.skipped == night.points > 0
    assert night.faults
