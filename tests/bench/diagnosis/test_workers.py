"""Processes that simulate for a diagnosis know what the user brought along."""

from __future__ import annotations

import pickle
from typing import TYPE_CHECKING, Any

import pytest

from bench.diagnosis import diagnosis
from bench.diagnosis.diagnosis import Diagnosis
from bench.diagnosis.workers import processes
from sim_backend.pixel.effects.registry import effects, forget_effect_files, load_effect_files

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def dimmer(dimmer_file: Path) -> None:
    load_effect_files([dimmer_file])


def test_without_files_of_the_user_nothing_is_set_up() -> None:
    assert processes(2).setup is None


@pytest.mark.usefixtures("dimmer")
def test_each_process_loads_the_files_of_the_user() -> None:
    setup = pickle.loads(pickle.dumps(processes(2).setup))  # noqa: S301 - our own, as another process gets it
    forget_effect_files()
    assert "dimmer" not in effects()
    setup()
    assert "dimmer" in effects()


@pytest.mark.usefixtures("dimmer")
def test_a_diagnosis_in_python_has_such_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    class Opened(Exception):
        pass

    asked: list[Any] = []

    def open_session(_: Any, __: Any, workforce: Any, **___: Any) -> Any:
        asked.append(workforce)
        raise Opened

    monkeypatch.setattr(diagnosis, "open_session", open_session)
    with pytest.raises(Opened):
        Diagnosis([], workers=3)
    assert asked[0].workers == 3
    assert asked[0].setup is not None
