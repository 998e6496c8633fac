"""The runner: what it leaves behind, and every way in which it can end."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
import pytest

from bench.run import StopFlag, assume_done, run_protocol
from bench.run.progress import BarProgress, LineProgress, Status, duration_text, progress_for
from bench.run.runner import new_run_id
from bench.station import Station
from bench.store import Run, RunError
from drivers.events.types import TRIGGER_DTYPE, EventChunk, empty_events, empty_triggers
from protocols import InputError, LoadedProtocol, parse_protocol, stimulus_of
from sim_backend.devices.camera import SimulatedCamera

if TYPE_CHECKING:
    from collections.abc import Iterator

StationMaker = Callable[..., Station]


def _journal(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]


def test_a_run_is_what_the_protocol_asked_for(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    station = make_station()
    result = run_protocol(protocol, station, tmp_path / "run")
    assert (result.done, result.total, result.stopped) == (4, 4, False)
    run = Run.open(tmp_path / "run")
    run.verify()
    assert run.header.id == result.run_id
    assert run.header.everything["protocol_text"] == protocol.text
    assert run.header.everything["station"]["identities"]["camera"]["serial"] == "sensor seed 3"
    assert run.header.everything["software"]["evs_bench"]
    for planned, point in zip(protocol.protocol.expand(), run.points(), strict=True):
        stimulus = stimulus_of(planned)
        assert (point.index, point.waveform, point.polarity) == (planned.index, planned.waveform, planned.polarity)
        assert (point.baseline_lux, point.log_contrast) == (planned.baseline_lux, planned.log_contrast)
        assert point.nd_od == planned.nd_od
        assert point.roi == planned.roi
        np.testing.assert_allclose(point.stimulus_t_s, stimulus.t_s, atol=1e-9)
        np.testing.assert_array_equal(point.stimulus_lux, stimulus.lux)
        np.testing.assert_allclose(point.pulse_start_s, stimulus.pulse_start_s, atol=1e-9)
        np.testing.assert_allclose(point.pulse_stop_s, stimulus.pulse_stop_s, atol=1e-9)
        assert point.duration_s == pytest.approx(stimulus.duration_s, abs=1e-9)
        assert len(point.triggers_t_us) == len(stimulus.t_s) - 1
        assert point.attributes["seed"] == planned.seed
        assert point.attributes["time_axis"] == ("edges_known" if planned.waveform == "constant" else "trigger")
    assert sum(point.n_events for point in run.points()) > 100
    biases = {point.index: point.bias["bias_diff_on"] for point in run.points()}
    dark = next(p.index for p in protocol.protocol.expand() if p.measurement == "dark")
    assert biases == {i: 20.0 if i == dark else 0.0 for i in range(4)}
    states = [line["state"] for line in _journal(tmp_path / "run")]
    assert states == ["run_started", *["planned"] * 4, *["started", "done"] * 4, "run_finished"]
    assert not station.light.connected
    assert station.light._world.level == 0.0  # type: ignore[attr-defined]


def test_points_say_how_well_their_light_is_known(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    station = make_station()
    filters = dict(station.calibration.filters)
    filters["nd2"] = replace(filters["nd2"], uncertainty=0.03)
    station.calibration = replace(station.calibration, filters=filters, light_uncertainty=0.02)
    run_protocol(protocol, station, tmp_path / "known")
    run_protocol(protocol, make_station(), tmp_path / "unknown")
    known, unknown = (Run.open(tmp_path / name).points() for name in ("known", "unknown"))
    told = [(point.attributes["lux_uncertainty"], point.attributes.get("nd_uncertainty")) for point in known]
    behind = [0.03 if planned.nd_od == 2.0 else None for planned in protocol.protocol.expand()]
    assert told == [(0.02, sd) for sd in behind]
    assert behind.count(0.03) == 1
    for point in unknown:
        assert not {"lux_uncertainty", "nd_uncertainty"} & set(point.attributes)


def test_each_edge_has_its_trigger(make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path) -> None:
    run_protocol(protocol, make_station(), tmp_path / "run")
    point = next(Run.open(tmp_path / "run").points())
    with h5py.File(point.path) as file:
        np.testing.assert_array_equal(file["stimulus/trigger"][()], [-1, *range(len(point.triggers_t_us))])
    np.testing.assert_allclose(point.stimulus_t_s[1:] * 1e6, point.triggers_t_us)


def test_a_source_that_is_timed_by_the_host(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    """Edges lie where the triggers saw them, 0.3 ms after they were written; windows move with them."""
    run_protocol(protocol, make_station(timing="host"), tmp_path / "run")
    planned = stimulus_of(protocol.protocol.expand()[0])
    point = next(Run.open(tmp_path / "run").points())
    np.testing.assert_allclose(point.stimulus_t_s[1:], planned.t_s[1:] + 3e-4, atol=2e-6)
    np.testing.assert_allclose(point.pulse_start_s, planned.pulse_start_s + 3e-4, atol=2e-6)
    with h5py.File(point.path) as file:
        # The axis of these is that of the triggers: its 0 is not later than one resolution away.
        np.testing.assert_allclose(file["stimulus/t_written"][1:], planned.t_s[1:], atol=4e-4)
        settled = file["stimulus/t_settled"][1:] - file["stimulus/t_written"][1:]
        np.testing.assert_allclose(settled, 2.3e-3, atol=1e-6)


def test_the_same_seed_gives_the_same_events_and_another_others(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    runs = {}
    for name, seed in (("a", 7), ("b", 7), ("c", 8)):
        run_protocol(protocol, make_station(), tmp_path / name, seed=seed)
        points = Run.open(tmp_path / name).points()
        runs[name] = np.concatenate([chunk for point in points for chunk in point.events()])
    np.testing.assert_array_equal(runs["a"], runs["b"])
    assert not np.array_equal(runs["a"], runs["c"])


def test_what_the_station_cannot_do_is_said_at_once_and_nothing_is_taken(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    text = protocol.text.replace("illuminance_lux: [100]\n      contrast", "illuminance_lux: [2000]\n      contrast")
    text = text.replace("nd_od: [2]", "nd_od: [3]").replace("bias_diff_on: 20", "bias_diff_on: 100")
    station = make_station()
    with pytest.raises(InputError) as error:
        run_protocol(parse_protocol(text, "x.yaml"), station, tmp_path / "run")
    lines = str(error.value).splitlines()
    # 2000 e lux are the upper level of the second square wave.
    assert lines[0].startswith(
        "square: points 0-1: 2000 to 5437 lux on chip behind filter clear: light source reaches"
    )
    assert len(lines) == 3
    assert any("no filter of optical density 3" in line for line in lines)
    assert any(line.startswith("dark: point") and "bias_diff_on" in line for line in lines)
    assert not (tmp_path / "run").exists()
    assert not station.light.connected


def test_an_existing_folder_is_refused_before_anything_is_switched_on(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    station = make_station()
    with pytest.raises(RunError, match="never overwrites"):
        run_protocol(protocol, station, tmp_path)
    assert station.identities() == {}


def test_the_operator_is_asked_once_before_the_first_point(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    text = protocol.text.replace('  - name: "dark"\n', '  - name: "dark"\n    operator: {before: put the cap on}\n')
    asked: list[str] = []
    run_protocol(parse_protocol(text, "x.yaml"), make_station(), tmp_path / "run", operator=asked.append)
    assert asked == ["put the cap on"]
    run_protocol(parse_protocol(text, "x.yaml"), make_station(), tmp_path / "run2", operator=assume_done)
    assert "operator step taken as done: put the cap on" in (tmp_path / "run2/evs-bench.log").read_text()
    with pytest.raises(InputError, match=r"dark: .*'put the cap on'.*--operator-steps assume"):
        run_protocol(parse_protocol(text, "x.yaml"), make_station(), tmp_path / "run3")
    assert not (tmp_path / "run3").exists()


class _StrayTrigger(SimulatedCamera):
    """Its trigger input sees one edge, which is none of the light's."""

    def chunks(self) -> Iterator[EventChunk]:
        yield EventChunk(empty_events(), np.array([(123_456, 1, 0)], TRIGGER_DTYPE))
        for chunk in super().chunks():
            yield EventChunk(chunk.events, empty_triggers())


def test_a_stray_trigger_does_not_move_the_time_axis(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    run_protocol(protocol, make_station(), tmp_path / "good")
    run_protocol(protocol, make_station(camera=_StrayTrigger), tmp_path / "stray")
    for good, stray in zip(Run.open(tmp_path / "good").points(), Run.open(tmp_path / "stray").points(), strict=True):
        edges = len(good.stimulus_t_s) - 1
        assert stray.attributes["time_axis"] in ("edges_known", "from_events")
        # What the answers of three periods tell.
        np.testing.assert_allclose(stray.stimulus_t_s, good.stimulus_t_s, atol=2e-3)
        np.testing.assert_allclose(stray.pulse_start_s, good.pulse_start_s, atol=2e-3)
        assert (stray.quality["edges_without_trigger"], stray.quality["triggers_without_edge"]) == (edges, 1)
        assert not edges or good.quality["edges_without_trigger"] == good.quality["triggers_without_edge"] == 0
    assert "triggers (1) do not fit the edges" in (tmp_path / "stray/evs-bench.log").read_text()


def test_another_seed_reaches_measurements_with_a_seed_of_their_own(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    text = protocol.text.replace('  - name: "square"\n', '  - name: "square"\n    seed: 3\n')
    seeds = {}
    for seed in (None, 7, 8):
        run_protocol(parse_protocol(text, "x.yaml"), make_station(), tmp_path / str(seed), seed=seed)
        seeds[seed] = [p.attributes["seed"] for p in Run.open(tmp_path / str(seed)).points()]
    assert all(len({seeds[None][i], seeds[7][i], seeds[8][i]}) == 3 for i in range(4))


def test_without_out_the_folder_is_the_id(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = protocol.text.replace("values: [0.5, 1.0]", "values: [0.5]")
    first = run_protocol(parse_protocol(text, "My Protocol.yaml"), make_station())
    second = run_protocol(parse_protocol(text, "My Protocol.yaml"), make_station())
    assert first.folder == Path("runs") / first.run_id
    assert first.run_id.endswith("Z-my-protocol")
    assert first.folder != second.folder


def test_a_run_id_sorts_by_time() -> None:
    now = datetime(2026, 11, 20, 21, 3, 11, tzinfo=UTC)
    assert new_run_id("on_family", now) == "2026-11-20T21-03-11.000Z-on-family"
    assert new_run_id("b", now) < new_run_id("a", now + timedelta(milliseconds=1))


def test_runs_of_the_same_moment_have_different_ids(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("bench.run.runner.new_run_id", lambda name: f"now-{name}")
    stop = StopFlag()
    stop.request()
    runs = [run_protocol(protocol, make_station(), stop=stop) for _ in range(3)]
    assert [run.run_id for run in runs] == ["now-small_run", "now-small_run-2", "now-small_run-3"]
    assert all(run.folder.name == run.run_id == Run.open(run.folder).header.id for run in runs)


def test_settling_times_pass_on_the_stations_clock(
    make_station: StationMaker, protocol: LoadedProtocol, tmp_path: Path
) -> None:
    station = make_station()
    begin = station.clock.now()
    run_protocol(protocol, station, tmp_path / "run")
    estimate = protocol.protocol.estimate()
    # The estimate counts the settling after a filter; the wheel itself takes a second to move, once.
    assert station.clock.now() - begin == pytest.approx(estimate.duration_s + 1.0, abs=1e-6)


def test_status_lines_say_what_is_left() -> None:
    stream = io.StringIO()
    progress = LineProgress(stream, every_s=10.0, now=iter([0.0, 5.0, 11.0, 12.0]).__next__)
    status = Status(0, 4, "on, 100 lux", 3700.0, None)
    for done in range(3):
        progress.update(replace(status, done=done))
    progress.update(replace(status, done=4))
    assert stream.getvalue().splitlines() == [
        "point 1 of 4: on, 100 lux",
        "point 3 of 4: on, 100 lux",
        "4 of 4 points done",
    ]


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_gets_a_bar_and_a_pipe_gets_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    terminal = _Terminal()
    bar = progress_for(terminal)
    bar.update(Status(1, 4, "on, 100 lux", 61.0, datetime(2026, 11, 20, 21, 3, tzinfo=UTC)))
    bar.message("stopping [soon]")
    bar.close()
    assert isinstance(bar, BarProgress)
    assert "point 2 of 4: on, 100 lux" in terminal.getvalue()
    assert "stopping [soon]" in terminal.getvalue()
    assert "61 s left, until 21:03" in terminal.getvalue()
    assert isinstance(progress_for(io.StringIO()), LineProgress)


@pytest.mark.parametrize(
    ("seconds", "text"), [(5.4, "5 s"), (100.0, "2 min"), (9660.0, "2 h 41 min"), (200_000.0, "2.3 days")]
)
def test_lengths_of_time_are_said_in_two_units_at_most(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text
