"""Damaged point files, with bytes changed at random and cut off: one line each, whatever HDF5 does with them."""

from __future__ import annotations

import shutil
import sys
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bench.store import Run, RunError
from bench.store import probe as probing
from bench.store.event_reader import read_events
from bench.store.reader import read_point
from protocols.points import Roi

if TYPE_CHECKING:
    from pathlib import Path

ROI = Roi(600, 300, 16, 16)


def _damaged(whole: bytes, trial: int) -> bytes:
    rng = np.random.default_rng([20261120, trial])
    data = bytearray(whole)
    if trial % 3 == 0:
        return bytes(data[: rng.integers(0, len(data))])
    # Half of the damage goes to the beginning, where HDF5 keeps its structure.
    end = len(data) if trial % 3 == 1 else 8192
    for position in rng.integers(0, end, size=int(rng.integers(1, 20))):
        data[position] = rng.integers(0, 256)
    return bytes(data)


@pytest.mark.slow
def test_damaged_files_are_refused_in_one_line(
    data_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(probing, "_START_S", 5.0)
    whole = (data_folder / "practice/practice_3/points/000001.h5").read_bytes()
    waiting = [tmp_path / f"{trial:03d}.h5" for trial in range(60)]
    for trial, path in enumerate(waiting):
        path.write_bytes(_damaged(whole, trial))
    messages = []
    while waiting:
        try:
            probing.probe(waiting)
            break
        except RunError as error:  # the library did not survive this one
            messages.append(str(error))
            waiting = [path for path in waiting if str(path) not in str(error)]
    for path in waiting:
        try:
            point = read_point(path, ROI)
            read = sum(len(chunk) for chunk in read_events(path, roi=point.roi))
            assert read == point.n_events
        except RunError as error:
            messages.append(str(error))
    assert len(messages) > 30
    assert all("\n" not in message for message in messages)


def test_a_file_that_kills_the_library_is_named(
    data_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The child process meets a real signal, at a file of our choice.
    shutil.copytree(data_folder / "practice/practice_3", tmp_path / "run")
    for path in sorted((tmp_path / "run/points").glob("*.h5"))[3:]:
        path.unlink()
    (tmp_path / "sitecustomize.py").write_text(
        "import os, signal, bench.store.probe as p\n"
        "original = p.read_point\n"
        "def deadly(path, roi):\n"
        "    if path.name == '000001.h5':\n"
        "        os.kill(os.getpid(), signal.SIGSEGV)\n"
        "    return original(path, roi)\n"
        "p.read_point = deadly\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(RunError, match=r"000001\.h5: damaged: the HDF5 library crashes on it"):
        next(Run.open(tmp_path / "run").points())


def test_a_file_on_which_the_library_never_ends_is_named(
    data_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(probing, "_START_S", 2.0)
    shutil.copytree(data_folder / "practice/practice_3", tmp_path / "run")
    for path in sorted((tmp_path / "run/points").glob("*.h5"))[1:]:
        path.unlink()
    (tmp_path / "sitecustomize.py").write_text(
        "import time, bench.store.probe as p\np.read_point = lambda path, roi: time.sleep(60)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(RunError, match="does not come to an end"):
        next(Run.open(tmp_path / "run").points())


def test_the_probe_imports_nothing_from_the_folder_it_is_started_in(
    data_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("bench", "protocols", "drivers"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('hostile')\n")
    monkeypatch.chdir(tmp_path)
    point = tmp_path / "p.h5"
    shutil.copy(next((data_folder / "practice/practice_3/points").glob("*.h5")), point)
    for path in (["", *sys.path], sys.path):
        monkeypatch.setattr(sys, "path", path)
        assert probing._read_in_child([point]) == (1, "crashes")
