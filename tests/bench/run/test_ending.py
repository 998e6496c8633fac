"""Every way in which a run can end before its time, and what it leaves behind then."""

from __future__ import annotations

import io
import json
import logging
import os
import signal
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pytest

from bench.logs import log_into, record_bug
from bench.run import StopFlag, run_protocol
from bench.run.progress import LineProgress, Status
from bench.station import DevicesFailed, Station
from bench.store import Run, RunError
from bench.store.run import sha256_of
from drivers.errors import DataLost, DeviceError
from protocols import LoadedProtocol, parse_protocol
from sim_backend.devices.light import SimulatedLightSource

if TYPE_CHECKING:
    from pathlib import Path

    from drivers.interfaces import PlayedWaveform, Waveform

StationMaker = Callable[..., Station]


def _journal(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]


class _FailingLight(SimulatedLightSource):
    """Fails when it plays for the third time."""

    played = 0

    def _play(self, waveform: Waveform) -> PlayedWaveform:
        self.played += 1
        if self.played == 3:
            raise DataLost(self.name, "play a waveform", "the line went dead", "check the cable")
        return super()._play(waveform)


def test_a_device_that_fails_ends_the_run_in_its_safe_state(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    station = make_station(light=_FailingLight)
    with pytest.raises(DeviceError, match="the line went dead"):
        run_protocol(protocol, station, tmp_path / "run")
    failed, aborted = _journal(tmp_path / "run")[-2:]
    assert (failed["state"], failed["point"]) == ("failed", 2)
    assert "the line went dead" in failed["reason"]
    assert aborted["state"] == "run_aborted"
    run = Run.open(tmp_path / "run")
    run.verify()
    assert len(run) == 2
    assert not list((tmp_path / "run/points").glob("*.part"))
    assert station.light._world.level == 0.0  # type: ignore[attr-defined]
    assert "Traceback" in (tmp_path / "run/evs-bench.log").read_text()


class _Interrupting(LineProgress):
    """Presses Ctrl-C while a point is taken."""

    def __init__(self, at: int, times: int = 1, which: signal.Signals = signal.SIGINT) -> None:
        super().__init__(io.StringIO(), 0.0)
        self.at, self.times, self.which = at, times, which

    def update(self, status: Status) -> None:
        super().update(status)
        if status.done == self.at:
            for _ in range(self.times):
                os.kill(os.getpid(), self.which)


def test_ctrl_c_stops_after_the_point(make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path) -> None:
    before = signal.getsignal(signal.SIGINT)
    progress = _Interrupting(at=1, times=1)
    result = run_protocol(protocol, make_station(), tmp_path / "run", progress=progress)
    assert (result.done, result.stopped) == (2, True)
    assert [line["state"] for line in _journal(tmp_path / "run")][-2:] == ["done", "run_aborted"]
    assert "press Ctrl-C again" in progress._stream.getvalue()  # type: ignore[attr-defined]
    assert signal.getsignal(signal.SIGINT) is before


def test_a_second_ctrl_c_stops_at_once(make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path) -> None:
    station = make_station()
    with pytest.raises(KeyboardInterrupt, match=r"after 1 of \d+ points; .* evs-bench resume .*run$"):
        run_protocol(protocol, station, tmp_path / "run", progress=_Interrupting(at=1, times=2))
    assert _journal(tmp_path / "run")[-1]["state"] == "run_aborted"
    assert len(Run.open(tmp_path / "run")) == 1
    assert station.light._world.level == 0.0  # type: ignore[attr-defined]


def test_a_wish_to_stop_from_before_takes_nothing(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    stop = StopFlag()
    stop.request()
    assert run_protocol(protocol, make_station(), tmp_path / "run", stop=stop).done == 0


def test_ctrl_c_while_the_operator_is_asked_ends_the_run_at_once(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    text = protocol.text.replace('  - name: "dark"\n', '  - name: "dark"\n    operator: {before: put the cap on}\n')

    def press(_step: str) -> None:
        os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        run_protocol(parse_protocol(text, "x.yaml"), make_station(), tmp_path / "run", operator=press)
    lines = _journal(tmp_path / "run")
    assert lines[-1]["state"] == "run_aborted"
    assert not any(line.get("point") == 3 and line["state"] != "planned" for line in lines)
    assert len(Run.open(tmp_path / "run")) == 3


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="there is no SIGHUP here")
def test_a_terminal_that_goes_away_stops_at_once_but_not_under_nohup(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    station = make_station()
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests themselves may run under nohup
    try:
        with pytest.raises(KeyboardInterrupt):
            run_protocol(protocol, station, tmp_path / "run", progress=_Interrupting(at=1, which=signal.SIGHUP))
        assert _journal(tmp_path / "run")[-1]["state"] == "run_aborted"
        assert station.light._world.level == 0.0  # type: ignore[attr-defined]
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        progress = _Interrupting(at=1, which=signal.SIGHUP)
        assert run_protocol(protocol, make_station(), tmp_path / "nohup", progress=progress).done == 4
    finally:
        signal.signal(signal.SIGHUP, before)


def test_an_interrupt_while_a_point_is_written_comes_after_it(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The interrupt lands in HDF5's own call of write; the point that is being finished becomes whole."""
    import bench.store.writer as module

    def pressed_twice(path: Path) -> str:
        for _ in range(2):
            os.kill(os.getpid(), signal.SIGINT)
        return sha256_of(path)

    monkeypatch.setattr(module, "sha256_of", pressed_twice)
    with pytest.raises(KeyboardInterrupt):
        run_protocol(protocol, make_station(), tmp_path / "run")
    states = [(line["state"], line.get("point")) for line in _journal(tmp_path / "run")]
    assert states[-3:] == [("started", 0), ("done", 0), ("run_aborted", None)]
    assert len(Run.open(tmp_path / "run")) == 1


class _StuckLight(SimulatedLightSource):
    """Plays, but cannot be made dark once it has played."""

    played = False

    def _play(self, waveform: Waveform) -> PlayedWaveform:
        self.played = True
        return super()._play(waveform)

    def _safe_state(self) -> None:
        if self.played:
            raise OSError(5, "Input/output error")
        super()._safe_state()


def test_a_light_that_cannot_be_made_dark_ends_the_run_with_an_error(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    line = "light source: could not be made dark: [Errno 5] Input/output error; switch it off by hand"
    with pytest.raises(DevicesFailed) as caught:
        run_protocol(protocol, make_station(light=_StuckLight), tmp_path / "run")
    assert caught.value.lines == (line,)
    assert line in (tmp_path / "run/evs-bench.log").read_text()
    assert len(Run.open(tmp_path / "run")) == 4
    with pytest.raises(DevicesFailed) as caught:
        run_protocol(
            protocol, make_station(light=_StuckLight), tmp_path / "run2", progress=_Interrupting(at=1, times=2)
        )
    assert caught.value.lines == (line,)


class _BrokenPipe(_StuckLight):
    def _play(self, waveform: Waveform) -> PlayedWaveform:
        super()._play(waveform)
        raise BrokenPipeError(32, "Broken pipe")


def test_what_a_driver_raises_names_the_device(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    with pytest.raises(DeviceError) as caught:
        run_protocol(protocol, make_station(light=_BrokenPipe), tmp_path / "run")
    assert str(caught.value).splitlines() == [
        "light source: play: [Errno 32] Broken pipe",
        "light source: could not be made dark: [Errno 5] Input/output error; switch it off by hand",
    ]
    assert "Broken pipe" in _journal(tmp_path / "run")[-1]["reason"]


def test_the_log_of_an_error_is_not_that_of_an_older_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    error = RuntimeError("in the run")
    with pytest.raises(RuntimeError), log_into(tmp_path / "run.log"):
        raise error
    assert record_bug(error) == tmp_path / "run.log"
    other = record_bug(RuntimeError("outside"))
    assert other.is_relative_to(tmp_path / "state")
    assert "outside" in other.read_text()


def test_a_full_disk_ends_the_run_in_one_line(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    station = make_station()
    monkeypatch.setattr("bench.store.point_writer.sync_file", full)
    with pytest.raises(RunError, match=r"000000\.h5: could not be written: No space left on device"):
        run_protocol(protocol, station, tmp_path / "run")
    assert list((tmp_path / "run/points").iterdir()) == []
    assert station.light._world.level == 0.0  # type: ignore[attr-defined]


def test_logging_is_left_as_it_was(make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path) -> None:
    before = list(logging.getLogger("evs_bench").handlers)
    run_protocol(protocol, make_station(), tmp_path / "run")
    assert logging.getLogger("evs_bench").handlers == before
