"""Importing recordings: a real one, made ones whose time axis is known, and descriptions with mistakes."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from bench.commands.import_ import command
from bench.importing import import_folder
from bench.store import PointData, Run, RunError
from drivers.events.encode import Evt3Encoder, raw_header
from drivers.events.raw import open_recording
from drivers.events.types import EVENT_DTYPE, TRIGGER_DTYPE
from protocols import InputError

if TYPE_CHECKING:
    from pathlib import Path

SENSOR = {"name": "IMX636", "width": 1280, "height": 720}
ROI = {"x": 600, "y": 300, "width": 16, "height": 16}
CONSTANT = {"waveform": "constant", "polarity": "both", "nd_od": 0, "constant": {"illuminance_lux": 10}}


def _describe(folder: Path, *points: dict[str, Any], **more: Any) -> Path:
    folder.mkdir(exist_ok=True)
    content = {"format": "evs-bench-run/1", "title": "made elsewhere", "sensor": SENSOR, "roi": ROI, **more}
    (folder / "recordings.yaml").write_text(yaml.safe_dump({**content, "points": list(points)}, sort_keys=False))
    return folder


@pytest.fixture(scope="module")
def square(data_folder: Path) -> PointData:
    """Return the point of the practice run with the strongest square wave of 20 slow periods."""
    run = Run.open(data_folder / "practice/practice_3")
    points = [p for p in run.points() if p.waveform == "square" and len(p.stimulus_t_s) == 41]
    return max(points, key=lambda p: (p.log_contrast, p.baseline_lux))


def _square_section(square: PointData, **changes: Any) -> dict[str, Any]:
    wave = {
        "period_s": 0.206, "duty": 0.5, "low_lux": float(square.stimulus_lux[0]),
        "high_lux": float(square.stimulus_lux[1]), "cycles": 20, "first_edge_s": 0.5,
    }  # fmt: skip
    section = {"file": "p.h5", "waveform": "square", "polarity": "both", "nd_od": 0, "square": wave}
    return {**section, "duration_s": square.duration_s, **changes}


def _imported(folder: Path, out: Path) -> PointData:
    run = Run.open(import_folder(folder, out))
    run.verify()
    (point,) = run.points()
    return point


def test_a_real_recording_as_a_constant_point(data_folder: Path, tmp_path: Path) -> None:
    recording = data_folder / "recordings/gen31_640x480_triggers.evt3"
    expected = json.loads((data_folder / "recordings/gen31_640x480_triggers.expected.json").read_text())
    folder = _describe(
        tmp_path / "in", {**CONSTANT, "file": recording.name},
        sensor={"name": "Gen3.1", "width": 640, "height": 480}, roi={"x": 0, "y": 0, "width": 640, "height": 480},
    )  # fmt: skip
    shutil.copy(recording, folder)
    point = _imported(folder, tmp_path / "out")
    events = np.concatenate(list(point.events()))
    decoded = [(c.events, c.triggers) for c in open_recording(recording, width=640, height=480).chunks()]
    original, triggers = (np.concatenate(part) for part in zip(*decoded, strict=True))
    start_us = min(expected["t_first"], int(triggers["t"][0]))
    assert (point.n_events, len(point.triggers_t_us)) == (expected["n_cd"], expected["n_trigger"])
    assert int(events["t"].sum()) == expected["sum_t"] - start_us * expected["n_cd"]
    np.testing.assert_array_equal(events["x"], original["x"])
    np.testing.assert_array_equal(point.triggers_t_us, triggers["t"] - start_us)
    last_us = max(expected["t_last"], int(triggers["t"][-1]))
    assert point.duration_s == pytest.approx((last_us - start_us) * 1e-6)
    assert point.quality == {"bytes_received": recording.stat().st_size, "decode_errors": 0}
    assert np.isnan(point.refractory_s)
    assert Run.open(tmp_path / "out").header.title == "made elsewhere"


def test_triggers_put_the_stimulus_where_it_was(square: PointData, tmp_path: Path) -> None:
    folder = _describe(tmp_path / "in", _square_section(square, align="trigger"))
    shutil.copy(square.path, folder / "p.h5")
    point = _imported(folder, tmp_path / "out")
    # The description says 0.5 s, the light went up at 0.103 s.
    np.testing.assert_allclose(point.stimulus_t_s, square.stimulus_t_s, atol=1e-6)
    np.testing.assert_allclose(point.stimulus_lux, square.stimulus_lux)
    np.testing.assert_allclose(point.pulse_start_s, square.pulse_start_s, atol=1e-6)
    np.testing.assert_allclose(point.pulse_stop_s, square.pulse_stop_s, atol=1e-6)
    np.testing.assert_array_equal(point.pulse_kind, square.pulse_kind)
    np.testing.assert_array_equal(np.concatenate(list(point.events())), np.concatenate(list(square.events())))
    assert point.attributes["time_axis"] == "trigger"
    assert point.attributes["time_offset_s"] == pytest.approx(-0.397)
    assert point.attributes["time_residual_s"] < 1e-6
    assert (point.quality["edges_without_trigger"], point.quality["triggers_without_edge"]) == (0, 0)
    assert point.log_contrast == pytest.approx(square.log_contrast)
    assert point.baseline_lux == square.baseline_lux


def test_lost_and_foreign_triggers_are_counted(square: PointData, tmp_path: Path) -> None:
    folder = _describe(tmp_path / "in", _square_section(square, align="trigger"))
    shutil.copy(square.path, folder / "p.h5")
    with h5py.File(folder / "p.h5", "r+") as file:
        t, p = file["triggers/t"][()], file["triggers/p"][()]
        keep = np.ones(len(t), bool)
        keep[[0, 7]] = False
        t, p = np.append(t[keep], 4_200_000), np.append(p[keep], 1)
        for name, values, units in (("t", t, "us"), ("p", p.astype(np.uint8), "1")):
            del file[f"triggers/{name}"]
            file.create_dataset(f"triggers/{name}", data=values).attrs["units"] = units
    point = _imported(folder, tmp_path / "out")
    np.testing.assert_allclose(point.stimulus_t_s, square.stimulus_t_s, atol=1e-6)
    assert (point.quality["edges_without_trigger"], point.quality["triggers_without_edge"]) == (2, 1)
    with h5py.File(point.path) as file:
        assert np.flatnonzero(file["stimulus/trigger"][()] == -1).tolist() == [0, 1, 8]


def test_events_tell_when_the_stimulus_began(square: PointData, tmp_path: Path) -> None:
    """Within the bound that it states: some time constants of 1 ms of the pixel are not known."""
    folder = _describe(tmp_path / "in", _square_section(square, align="from_events"))
    shutil.copy(square.path, folder / "p.h5")
    point = _imported(folder, tmp_path / "out")
    late = point.stimulus_t_s[1:] - square.stimulus_t_s[1:]
    assert np.ptp(late) < 5e-5  # a rate of the clocks is fitted, too
    assert np.abs(late).max() <= point.attributes["time_bound_s"] < 0.005
    assert point.quality["time_doubtful"] == 0
    assert point.attributes["time_axis"] == "from_events"
    assert point.attributes["time_residual_s"] < 0.005


def test_noise_alone_does_not_tell_when_the_stimulus_began(
    data_folder: Path, square: PointData, tmp_path: Path
) -> None:
    section = _square_section(square, align="from_events", duration_s=20.0)
    folder = _describe(tmp_path / "in", section)
    shutil.copy(data_folder / "practice/practice_3/points/000000.h5", folder / "p.h5")
    point = _imported(folder, tmp_path / "out")
    assert point.quality["time_doubtful"] == 1
    assert point.quality["time_note"]


def _recording(path: Path, t: list[int], x: list[int], triggers: list[tuple[int, int, int]]) -> None:
    events = np.zeros(len(t), EVENT_DTYPE)
    events["t"], events["x"], events["y"] = t, x, 305
    path.write_bytes(raw_header(1280, 720) + Evt3Encoder(1280, 720).feed(events, np.array(triggers, TRIGGER_DTYPE)))


def test_windows_of_time_and_pixels_are_cut_and_counted(tmp_path: Path) -> None:
    section = {**CONSTANT, "file": "r.raw", "start_us": 1000, "time_window_s": [0.5, 2.0], "trigger_channel": 3}
    folder = _describe(tmp_path / "in", {**section, "bias": {"bias_fo": 20}, "ambient": "capped"})
    times = [900, 501_000, 600_000, 700_000, 2_000_999, 2_001_000]
    _recording(folder / "r.raw", times, [600, 600, 500, 615, 601, 600], [(502_000, 1, 3), (503_000, 1, 2)])
    point = _imported(folder, tmp_path / "out")
    (events,) = point.events()
    assert events["t"].tolist() == [0, 199_000, 1_499_999]
    assert point.triggers_t_us.tolist() == [1000]
    assert point.duration_s == 1.5
    counts = {name: point.quality[name] for name in ("before_start", "after_end", "outside_roi")}
    assert counts == {"before_start": 1, "after_end": 1, "outside_roi": 1}
    assert point.bias == {"bias_fo": 20.0}
    assert point.attributes["ambient"] == "capped"


def test_without_a_start_the_first_event_or_trigger_is_zero(tmp_path: Path) -> None:
    folder = _describe(tmp_path / "in", {**CONSTANT, "file": "r.raw"})
    _recording(folder / "r.raw", [8000, 9000], [600, 601], [(7000, 1, 0)])
    point = _imported(folder, tmp_path / "out")
    assert next(point.events())["t"].tolist() == [1000, 2000]
    assert point.triggers_t_us.tolist() == [0]
    assert point.duration_s == pytest.approx(0.002)


def test_a_stimulus_given_by_its_edges(tmp_path: Path) -> None:
    section = {
        "file": "r.raw", "waveform": "reset_test", "polarity": "on", "nd_od": 1, "start_us": 0, "duration_s": 2.0,
        "baseline_lux": 10, "log_contrast": 0.5, "reset_log_contrast": 0.7, "temperature_c": 31.5,
        "edges": [[0, 10], [0.5, 20], [0.6, 10], [1.0, 16.487], [1.2, 10], [1.9, 16.487]],
        "pulses": [
            {"start_s": 1.0, "stop_s": 1.1, "direction": "up"}, {"start_s": 1.9, "stop_s": 2.1, "direction": "up"},
        ],
    }  # fmt: skip
    folder = _describe(tmp_path / "in", section)
    _recording(folder / "r.raw", [1000], [600], [])
    point = _imported(folder, tmp_path / "out")
    assert point.stimulus_t_s.tolist() == [0, 0.5, 0.6, 1.0, 1.2, 1.9]
    assert point.pulse_start_s.tolist() == [1.0, 1.9]
    assert point.pulse_valid.tolist() == [True, False]  # the second window ends after the recording
    assert point.quality["windows_outside"] == 1
    assert point.attributes["reset_log_contrast"] == 0.7
    assert (point.nd_od, point.temperature_c) == (1.0, 31.5)


def test_reset_and_test_pulses_from_a_few_numbers(tmp_path: Path) -> None:
    pulse = {"baseline_lux": 10, "reset_lux": 5, "test_lux": 8, "gap_s": 0.1, "reset_s": 0.1, "test_s": 0.05}
    section = {
        "file": "r.raw", "waveform": "reset_test", "polarity": "off", "nd_od": 0, "duration_s": 1.0, "start_us": 0,
        "reset_test": {**pulse, "cycles": 2, "first_edge_s": 0.2, "window_s": 0.08},
    }  # fmt: skip
    folder = _describe(tmp_path / "in", section, id="my-run", station={"who": "another lab"})
    _recording(folder / "r.raw", [1000], [600], [])
    point = _imported(folder, tmp_path / "out")
    np.testing.assert_allclose(point.stimulus_t_s, [0, 0.2, 0.3, 0.4, 0.45, 0.55, 0.65, 0.75, 0.8])
    np.testing.assert_allclose(point.pulse_start_s, [0.4, 0.75])
    np.testing.assert_allclose(point.pulse_stop_s, [0.48, 0.83])
    assert point.pulse_kind.tolist() == [1, 1]
    assert point.log_contrast == pytest.approx(np.log(10 / 8))
    assert point.attributes["reset_log_contrast"] == pytest.approx(np.log(2))
    header = Run.open(tmp_path / "out").header
    assert (header.id, header.everything["station"]) == ("my-run", {"who": "another lab"})


MISTAKES = """\
format: evs-bench-run/1
sensor: {name: S, width: 64, height: 48}
roi: {x: 60, y: 0, width: 16, height: 16}
points:
  - {file: a.raw, waveform: constant, polarity: both, nd_od: 0, constant: {illuminance_lux: 1}, algin: trigger}
  - {file: b.raw, waveform: square, polarity: both, nd_od: 0, constant: {illuminance_lux: 1}}
  - {file: c.raw, waveform: constant, polarity: both, constant: {illuminance_lux: -1}}
"""


def test_mistakes_are_said_all_at_once_with_their_places(tmp_path: Path) -> None:
    (tmp_path / "recordings.yaml").write_text(MISTAKES)
    with pytest.raises(InputError) as error:
        import_folder(tmp_path, tmp_path / "out")
    lines = [str(problem).removeprefix(str(tmp_path)) for problem in error.value.problems]
    assert [line.split(":")[1] for line in lines] == ["5", "6", "7", "7"], lines
    assert "did you mean 'align'" in lines[0]
    assert not (tmp_path / "out").exists()


def _nothing_left(folder: Path) -> bool:
    return [path.name for path in folder.iterdir()] == ["in"]


def test_recordings_that_are_not_there_are_all_named(tmp_path: Path) -> None:
    folder = _describe(tmp_path / "in", {**CONSTANT, "file": "a.raw"}, {**CONSTANT, "file": "b.xyz"})
    (folder / "b.xyz").write_bytes(b"\0" * 10)
    with pytest.raises(InputError) as error:
        import_folder(folder, tmp_path / "out")
    assert len(error.value.problems) == 2
    assert "points.0" in str(error.value)
    assert _nothing_left(tmp_path)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"align": "trigger"}, "none of its 0 triggers fits"),
        ({"align": "edges_known"}, "the stimulus lasts from 0.5 to"),
        ({"align": "from_events", "duration_s": 1.0}, "the stimulus is longer than the recording"),
    ],
)
def test_a_stimulus_that_does_not_fit_leaves_nothing(
    square: PointData, tmp_path: Path, change: dict[str, Any], says: str
) -> None:
    good = {**CONSTANT, "file": "p.h5"}
    folder = _describe(tmp_path / "in", good, _square_section(square, file="r.raw", **change))
    shutil.copy(square.path, folder / "p.h5")
    _recording(folder / "r.raw", [1000, 2000], [600, 600], [])
    with pytest.raises(InputError, match=says):
        import_folder(folder, tmp_path / "out")
    assert _nothing_left(tmp_path)


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    folder = _describe(tmp_path / "in", {**CONSTANT, "file": "r.raw"})
    _recording(folder / "r.raw", [1000], [600], [])
    (tmp_path / "out").mkdir()
    with pytest.raises(RunError, match="never overwrites"):
        import_folder(folder, tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


def test_a_folder_without_a_description(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"recordings\.yaml: cannot be read"):
        import_folder(tmp_path, tmp_path / "out")


def test_a_damaged_point_file_is_one_line(square: PointData, tmp_path: Path) -> None:
    folder = _describe(tmp_path / "in", {**CONSTANT, "file": "p.h5"})
    (folder / "p.h5").write_bytes(square.path.read_bytes()[:5000])
    with pytest.raises(InputError, match=r"p\.h5: damaged"):
        import_folder(folder, tmp_path / "out")
    assert _nothing_left(tmp_path)


@pytest.mark.parametrize(("told_lux", "fits"), [(10.0, True), (10.001, True), (11.0, False)])
def test_a_level_may_be_told_twice_if_both_agree(told_lux: float, fits: bool, tmp_path: Path) -> None:
    section = {**CONSTANT, "file": "r.raw", "baseline_lux": told_lux, "log_contrast": 0, "start_us": 0}
    folder = _describe(tmp_path / "in", {**section, "duration_s": 1.0}, id="twice")
    _recording(folder / "r.raw", [1000], [600], [])
    if fits:
        assert _imported(folder, tmp_path / "out").baseline_lux == 10.0
        return
    with pytest.raises(InputError, match="baseline_lux: is 11, but the stimulus gives 10"):
        import_folder(folder, tmp_path / "out")


def test_a_duration_cuts_what_comes_later(tmp_path: Path) -> None:
    folder = _describe(tmp_path / "in", {**CONSTANT, "file": "r.raw", "start_us": 0, "duration_s": 0.1})
    _recording(folder / "r.raw", [1000, 99_999, 100_000, 2_000_000], [600] * 4, [(50_000, 1, 0), (150_000, 1, 0)])
    point = _imported(folder, tmp_path / "out")
    assert next(point.events())["t"].tolist() == [1000, 99_999]
    assert point.triggers_t_us.tolist() == [50_000]
    assert point.quality["after_end"] == 3
    assert "after end: 3" in (tmp_path / "out/evs-bench.log").read_text()


def test_a_time_window_ends_within_the_recording(tmp_path: Path) -> None:
    section = {**CONSTANT, "file": "r.raw", "start_us": 0, "time_window_s": [0.0, 100.0]}
    folder = _describe(tmp_path / "in", section)
    _recording(folder / "r.raw", [1000, 2_000_000], [600] * 2, [])
    with pytest.raises(InputError, match="ends at 100 s, but the recording ends at 2 s"):
        import_folder(folder, tmp_path / "out")
    _describe(folder, {**section, "duration_s": 100.0})
    assert _imported(folder, tmp_path / "out").duration_s == 100.0


def test_a_recording_outside_the_folder_is_refused(tmp_path: Path) -> None:
    _recording(tmp_path / "r.raw", [1000], [600], [])
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "link.raw").symlink_to(tmp_path / "r.raw")
    names = ("../r.raw", str(tmp_path / "r.raw"), "link.raw")
    _describe(folder, *({**CONSTANT, "file": name, "duration_s": 1.0} for name in names))
    with pytest.raises(InputError) as error:
        import_folder(folder, tmp_path / "out")
    assert [("leads outside" in str(problem)) for problem in error.value.problems] == [True] * 3


def test_marks_of_bad_data_are_carried_over(square: PointData, tmp_path: Path) -> None:
    window = [0.1, square.duration_s]
    section = _square_section(square, align="trigger", time_window_s=window, bias={"b": 2.0})
    folder = _describe(tmp_path / "in", section)
    shutil.copy(square.path, folder / "p.h5")
    valid = np.ones(len(square.pulse_start_s), np.uint8)
    valid[4] = 0
    with h5py.File(folder / "p.h5", "r+") as file:
        for name in ("quality/gaps", "pixels/masked", "pulses/valid"):
            if name in file:
                del file[name]
        file.create_dataset("quality/gaps", data=[[0.05, 0.2], [0.4, 0.5]]).attrs["units"] = "s"
        file.create_dataset("pixels/masked", data=np.array([[3, 4]], np.uint16)).attrs["units"] = "pixel"
        file.create_dataset("pulses/valid", data=valid).attrs["units"] = "1"
        file["quality"].attrs["decode_errors"] = 7
        file.require_group("bias").attrs.update({"a": 1.0, "b": 1.0})
        file.attrs.update({"seed": 5, "ambient": "capped", "temperature_c": 31.0})
    point = _imported(folder, tmp_path / "out")
    np.testing.assert_allclose(point.gaps_s, [[0.0, 0.1], [0.3, 0.4]])
    assert point.masked.tolist() == [[3, 4]]
    bad = point.pulse_start_s[~point.pulse_valid]
    np.testing.assert_allclose(bad, square.pulse_start_s[[4]] - 0.1, atol=1e-5)
    assert {"a": 1.0, "b": 2.0}.items() <= point.bias.items()
    assert (point.quality["decode_errors"], point.temperature_c) == (7, 31.0)
    assert (point.attributes["seed"], point.attributes["ambient"]) == (5, "capped")


def test_the_command_tells_the_warnings(tmp_path: Path) -> None:
    folder = _describe(tmp_path / "in", {**CONSTANT, "file": "r.raw", "start_us": 0, "duration_s": 0.1})
    _recording(folder / "r.raw", [1000, 200_000], [600] * 2, [])
    done = CliRunner().invoke(command, [str(folder), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0
    assert "warning:" in done.stderr
    assert "after end: 1" in done.stderr
    assert done.stdout.strip() == str(tmp_path / "out")


def test_marks_that_cannot_be_kept_are_refused(square: PointData, tmp_path: Path) -> None:
    folder = _describe(tmp_path / "in", _square_section(square))
    shutil.copy(square.path, folder / "p.h5")
    with h5py.File(folder / "p.h5", "r+") as file:
        file.create_dataset("quality/doubtful_events", data=[1, 2])
    with pytest.raises(InputError, match="/quality/doubtful_events: an import cannot keep"):
        import_folder(folder, tmp_path / "out")
