"""An operator at another terminal: pause, continue, abort; and what is said where nobody takes the run."""

from __future__ import annotations

import _thread
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from night_devices import Telling, journal, light, states, with_policy  # type: ignore[import-not-found]

from bench import cli
from bench.cli import run as command
from bench.run import resume, run_protocol
from bench.run.control import Control, Wish, ask, was_heard
from bench.run.states import State, state_of
from bench.station import Station
from bench.store import Run, RunError
from bench.store.journal import read_journal
from bench.store.writer import is_being_written

if TYPE_CHECKING:
    from protocols import LoadedProtocol

StationMaker = Callable[..., Station]
PATIENCE_S = 60.0


@pytest.fixture(autouse=True)
def commands(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the commands, whatever the list of commands says."""
    for name in ("pause", "continue", "abort"):
        monkeypatch.setitem(cli._COMMANDS, name, name)
    monkeypatch.setitem(cli._MODULES, "continue", "continue_")


def _until(reached: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not reached():
        assert time.monotonic() < end, "it did not come to that"
        time.sleep(0.02)


class _Elsewhere:
    """Another terminal: does something meanwhile, in a thread; its failure is the test's."""

    def __init__(self, do: Callable[[], None]) -> None:
        self._error: BaseException | None = None
        self._do = do
        self._thread = threading.Thread(target=self._work, daemon=True)

    def _work(self) -> None:
        try:
            self._do()
        except BaseException as error:  # noqa: BLE001 - end() raises it
            self._error = error
            for _ in range(2):  # the run would wait for ever
                _thread.interrupt_main()

    def begin(self) -> None:
        self._thread.start()

    def end(self) -> None:
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()
        if self._error is not None:
            raise self._error


def test_a_run_is_paused_in_the_dark_and_goes_on(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    folder, station = tmp_path / "run", make_station()

    def elsewhere() -> None:
        _until(lambda: state_of(read_journal(folder / "journal.jsonl"))[0] == State.PAUSED)
        assert station.light._world.level == 0.0  # type: ignore[attr-defined]
        assert is_being_written(folder)
        assert command(["continue", str(folder)]) == 0

    other = _Elsewhere(elsewhere)

    def pause() -> None:
        ask(folder, Wish.PAUSE)
        other.begin()

    told = Telling(1, pause)
    try:
        assert run_protocol(protocol, station, folder, progress=told).done == 4
    finally:
        other.end()
    found = [(state, point) for state, point, _ in states(folder)]
    # The wish came while point 1 was about to begin.
    assert found[3:7] == [("started", 1), ("done", 1), ("paused", None), ("resumed", None)]
    assert f"paused: by the operator; go on with: evs-bench continue {folder}" in told.text
    assert not list(folder.glob("control.json*"))
    assert not is_being_written(folder)


def test_a_run_is_aborted_in_the_middle_of_a_point_and_resumed(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    station = make_station(light=light(hangs_at=frozenset({2})))

    def elsewhere() -> None:
        _until(lambda: (folder / "points/000001.h5.part").exists())
        assert command(["abort", str(folder)]) == 0

    other = _Elsewhere(elsewhere)
    other.begin()
    begin_s = time.monotonic()
    with pytest.raises(
        KeyboardInterrupt, match=r"stopped at once, after 1 of 4 points.*; go on with: evs-bench resume"
    ):
        run_protocol(protocol, station, folder)
    assert time.monotonic() - begin_s < 55.0  # the light source would have hung for 60 s
    other.end()
    last = journal(folder)[-1]
    assert (last["state"], last["end"]) == ("run_aborted", "aborted")
    assert last["reason"] == "aborted by the operator, from another terminal"
    assert station.light._world.level == 0.0  # type: ignore[attr-defined]
    assert [path.name for path in (folder / "points").iterdir()] == ["000000.h5"]
    Run.open(folder).verify()


def test_a_failure_may_wait_for_the_operator(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    waiting = with_policy(protocol, "policy: {on_failure: {then: pause}}")

    def elsewhere() -> None:
        _until(lambda: (folder / "journal.jsonl").exists())
        _until(lambda: state_of(read_journal(folder / "journal.jsonl"))[0] == State.PAUSED)
        assert "the line went dead" in str(state_of(read_journal(folder / "journal.jsonl"))[1])
        ask(folder, Wish.CONTINUE)

    other = _Elsewhere(elsewhere)
    other.begin()
    try:
        assert run_protocol(waiting, make_station(light=light(fails_at=frozenset({3}))), folder).done == 4
    finally:
        other.end()


@pytest.mark.parametrize("wish", ["pause", "continue", "abort"])
def test_a_wish_that_nobody_hears_is_refused_in_one_line(
    wish: str,
    make_station: StationMaker,
    protocol: LoadedProtocol,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert command([wish, str(tmp_path / "none")]) == 1
    assert capsys.readouterr().err == f"evs-bench: {tmp_path / 'none'}: there is no such run\n"
    run_protocol(protocol, make_station(), tmp_path / "run")
    assert command([wish, str(tmp_path / "run")]) == 1
    line = f"nobody is taking this run now; go on with it: evs-bench resume {tmp_path / 'run'}"
    assert capsys.readouterr().err == f"evs-bench: {tmp_path / 'run'}: {line}\n"
    assert not list((tmp_path / "run").glob("control*"))


@pytest.mark.parametrize("content", [b"", b"{", b'{"wish": "dance"}', b"[]", b'{"wish": {}}', b"\xff\xfe"])
def test_what_is_no_wish_is_taken_away_and_nothing_comes_of_it(content: bytes, tmp_path: Path) -> None:
    aborted: list[bool] = []
    control = Control(tmp_path, lambda: aborted.append(True))
    (tmp_path / "control.json").write_bytes(content)
    assert not control.pause
    assert was_heard(tmp_path, 0.0)
    assert not list(tmp_path.iterdir())
    assert not aborted


def test_the_last_wish_counts(tmp_path: Path) -> None:
    control = Control(tmp_path, lambda: None)
    for wish, paused in (("pause", True), ("pause", True), ("continue", False)):
        (tmp_path / "control.json").write_text(f'{{"wish": "{wish}"}}')
        assert control.pause == paused


def test_a_wish_from_before_is_none_of_the_run_that_is_gone_on_with(protocol: LoadedProtocol, tmp_path: Path) -> None:
    from bench.station import load_station

    folder = tmp_path / "run"

    def stop() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_protocol(protocol, load_station("simulated"), folder, progress=Telling(1, stop))
    (folder / "control.json").write_text('{"wish": "pause"}')
    assert resume(folder).done == 4


def test_two_processes_on_one_run(make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path) -> None:
    def second() -> None:
        with pytest.raises(RunError, match="exists already"):
            run_protocol(protocol, make_station(), tmp_path / "run")

    assert run_protocol(protocol, make_station(), tmp_path / "run", progress=Telling(1, second)).done == 4
