"""A run folder that is removed or renamed while the run is going on."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from failing_disk import is_as, short_protocol  # type: ignore[import-not-found]
from night_devices import Telling, states  # type: ignore[import-not-found]

from bench.run import resume, run_protocol
from bench.station import load_station
from bench.store import Run, RunError
from bench.store.writer import RunWriter

if TYPE_CHECKING:
    from collections.abc import Callable

_GONE = "was removed or renamed, put it back"


def _ended(tmp_path: Path, at: int, do: Callable[[], None]) -> tuple[str, str]:
    """Take a run to which this happens after so many points; return how it ended, and what the operator was told."""
    station, told = load_station("simulated"), Telling(at, do)
    with pytest.raises(RunError) as caught:
        run_protocol(short_protocol(), station, tmp_path / "run", progress=told)
    assert station.light._world.level == 0.0  # type: ignore[attr-defined]
    return str(caught.value), told.text


@pytest.mark.parametrize("at", [0, 1])
def test_a_folder_that_is_removed_ends_the_run_and_says_so(tmp_path: Path, at: int) -> None:
    line, told = _ended(tmp_path, at, lambda: shutil.rmtree(tmp_path / "run"))
    assert line.endswith(f"{tmp_path / 'run'} {_GONE}")
    assert "resume" not in told
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_renamed_keeps_what_is_done_and_is_gone_on_with(tmp_path: Path) -> None:
    run_protocol(short_protocol(), load_station("simulated"), tmp_path / "whole")
    line, _ = _ended(tmp_path, 1, lambda: _rename(tmp_path / "run", tmp_path / "other"))
    assert line.endswith(_GONE)
    assert not (tmp_path / "run").exists()
    assert len(Run.open(tmp_path / "other")) == 1
    assert states(tmp_path / "other")[-1][0] == "run_aborted"
    resume(tmp_path / "other")
    is_as(tmp_path / "other", tmp_path / "whole")


def test_a_run_that_lost_its_folder_at_the_very_end_is_not_called_finished(tmp_path: Path) -> None:
    line, _ = _ended(tmp_path, 2, lambda: _rename(tmp_path / "run", tmp_path / "other"))
    assert line.endswith(_GONE)
    assert len(Run.open(tmp_path / "other")) == 2


def test_another_journal_in_the_place_of_the_first_gets_no_lines(tmp_path: Path) -> None:
    other = tmp_path / "run/journal.jsonl"
    with RunWriter(tmp_path / "run", {"id": "a"}) as writer:
        other.unlink()
        other.write_text("")
        with pytest.raises(RunError, match="another file is in its place"):
            writer.note("run_finished")
    assert other.read_text() == ""


def _rename(folder: Path, name: Path) -> None:
    folder.rename(name)
