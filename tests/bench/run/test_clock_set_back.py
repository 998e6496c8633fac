"""A clock that is set back, in the middle of a run and between a stop and what is left of it."""

from __future__ import annotations

import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from failing_disk import is_as, short_protocol  # type: ignore[import-not-found]
from night_devices import Telling  # type: ignore[import-not-found]

from bench.catalogue.catalogue import read_catalogue
from bench.catalogue.counts import count_journal
from bench.run import resume, run_protocol
from bench.run.stop import StopFlag
from bench.station import load_station
from bench.store import Run
from bench.store.journal import JournalEntry

_BACK = [timedelta(hours=1), timedelta(days=365)]
_BEGIN = datetime(2026, 11, 23, 22, 0, tzinfo=UTC)


class _Clock:
    """The date of a computer: every look is a second later, and somebody sets it back."""

    def __init__(self) -> None:
        self.now = _BEGIN

    def __call__(self) -> str:
        self.now += timedelta(seconds=1)
        return self.now.isoformat()

    def set_back(self, by: timedelta) -> None:
        self.now -= by


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> _Clock:
    """Return the clock that the journal is written by."""
    found = _Clock()
    monkeypatch.setattr("bench.store.writer.utc_now", found)
    return found


@pytest.mark.parametrize("by", _BACK)
def test_a_run_goes_on_and_says_how_long_it_took(tmp_path: Path, clock: _Clock, by: timedelta) -> None:
    told = Telling(1, lambda: clock.set_back(by))
    assert run_protocol(short_protocol(), load_station("simulated"), tmp_path / "run", progress=told).done == 2
    Run.open(tmp_path / "run").verify()
    lines = len((tmp_path / "run/journal.jsonl").read_text().splitlines())
    entry = read_catalogue(tmp_path).entries[0]
    assert (entry.state, entry.done) == ("finished", 2)
    assert entry.duration_s is not None
    assert lines - 4 <= entry.duration_s < lines  # but for the seconds in which it was set back


@pytest.mark.parametrize("by", _BACK)
def test_the_rest_is_taken_where_it_was_set_back_meanwhile(tmp_path: Path, clock: _Clock, by: timedelta) -> None:
    run_protocol(short_protocol(), load_station("simulated"), tmp_path / "whole")
    stop = StopFlag()
    run_protocol(
        short_protocol(), load_station("simulated"), tmp_path / "run", stop=stop, progress=Telling(0, stop.request)
    )
    clock.set_back(by)
    resume(tmp_path / "run")
    is_as(tmp_path / "run", tmp_path / "whole")
    states = {entry.folder: (entry.state, entry.done) for entry in read_catalogue(tmp_path).entries}
    assert states["run"] == ("finished", 2)


def test_the_time_of_a_run_is_that_of_its_sessions_without_what_the_clock_lost() -> None:
    def line(state: str, after_s: float, point: int | None = None) -> JournalEntry:
        return JournalEntry(state, point, (_BEGIN + timedelta(seconds=after_s)).isoformat())

    begun = [line("run_started", 0), line("started", 5, 0), line("done", 10, 0)]
    back = [line("started", -3590, 1), line("done", -3580, 1), line("run_aborted", -3579)]
    later = [line("resumed", 90_000), line("started", 90_001, 2), line("done", 90_004, 2)]
    assert count_journal([*begun, *back]).duration_s == 21.0
    assert count_journal([*begun, *back, *later]).duration_s == 25.0
    assert count_journal([]).duration_s is None


def test_a_run_of_the_same_moment_gets_another_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("bench.run.runner.new_run_id", lambda _: "2026-11-23T22-00-00.000Z-short")
    names = [run_protocol(short_protocol(), load_station("simulated")).folder.name for _ in range(2)]
    assert names == ["2026-11-23T22-00-00.000Z-short", "2026-11-23T22-00-00.000Z-short-2"]
