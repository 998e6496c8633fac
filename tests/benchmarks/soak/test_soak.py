"""A short form of the soak: every place of a kill at least once, and half an hour of a night with faults."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import h5py
import pytest

from benchmarks.soak.kills import Kills, _at_the_end, _content, _looked_through, _take, kill_and_resume
from benchmarks.soak.night import spend_a_night
from benchmarks.soak.places import PLACES

if TYPE_CHECKING:
    from pathlib import Path


def nobody(text: str) -> None:
    """Tell nobody."""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are forked")
def test_kills_at_every_place_lose_nothing(tmp_path: Path) -> None:
    found = kill_and_resume(tmp_path / "kills", len(PLACES), 3, nobody)
    assert found.problems == []
    assert set(found.places) == set(PLACES)


@pytest.mark.slow
def test_half_an_hour_of_a_night_with_faults(tmp_path: Path) -> None:
    night = spend_a_night(tmp_path / "night", 0.5, 7, nobody)
    assert night.problems == []
    assert night.done + night.skipped == night.points > 0
    assert night.faults


def test_what_is_lost_or_changed_is_seen(tmp_path: Path) -> None:
    """The soak itself must be able to fail."""
    whole, other = tmp_path / "whole", tmp_path / "other"
    for folder in (whole, other):
        _take(folder)
    wanted = _content(whole)
    assert list(_at_the_end(other, wanted)) == []
    done = _looked_through(other, {}, Kills())
    with h5py.File(other / "points/000001.h5", "r+") as file:
        file["events/x"][0] += 1
    (other / "points/000002.h5").unlink()
    found = Kills()
    _looked_through(other, {**done, 99: ("points/000099.h5", "")}, found)
    assert [text.split(": ", 1)[1][:9] for text in found.problems] == ["point 99 ", "point 1 i", "point 2 i"]
    said = "\n".join(_at_the_end(other, wanted))
    assert "000001.h5:events/x is not that" in said
    assert "000002.h5:events/t is not that" in said
