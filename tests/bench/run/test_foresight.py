"""What a run will ask for: its end, the filters to put in by hand and when, contrasts that have steps, the disk."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
import yaml

from bench.catalogue.pace import changes_of, waits_s
from bench.run import check
from bench.run.foresight import ContrastError, foresee, worst_contrast
from bench.run.plan import plan
from bench.station import Station
from drivers.clock import RealClock
from drivers.filters.manual import ManualFilter
from protocols import LoadedProtocol, parse_protocol
from protocols.estimation import recording_s

if TYPE_CHECKING:
    from pathlib import Path

    from protocols.schema import Protocol

StationMaker = Callable[..., Station]

LEVELS = """\
format: evs-bench-protocol/1
title: levels and filters
roi: {x: 0, y: 0, width: 4, height: 4}
settle: {light_s: 1.0, filter_s: 2.0, bias_s: 4.0}
measurements:
  - name: bright
    stimulus: {kind: constant, duration_s: 60.0}
    sweep: {illuminance_lux: [100, 200], nd_od: [0]}
  - name: dim
    stimulus: {kind: constant, duration_s: 60.0}
    sweep: {illuminance_lux: [1, 2], nd_od: [2]}
  - name: capped
    ambient: capped
    operator: {before: Put the lens cap on.}
    stimulus: {kind: constant, duration_s: 60.0}
    sweep: {illuminance_lux: [0], nd_od: [2]}
"""
STEPS = """\
format: evs-bench-protocol/1
title: steps
roi: {x: 0, y: 0, width: 4, height: 4}
pulses: 2
measurements:
  - name: "m"
    stimulus: {kind: square, frequency_hz: 5}
    sweep:
      illuminance_lux: [100]
      contrast: {scale: log, values: [0.1, 0.4, 1.0]}
"""


@pytest.fixture(name="levels")
def protocol_of_levels() -> Protocol:
    return parse_protocol(LEVELS, "levels.yaml").protocol


@pytest.fixture(name="by_hand")
def station_by_hand(make_station: StationMaker) -> Station:
    """Return the small station as it would be on a real bench, with filters that are put in by hand."""
    station = make_station()
    station.clock = RealClock()
    station.wheel = ManualFilter({"clear": 0.0, "nd2": 2.0})
    return station


def _write_run(folder: Path, protocol: Protocol, beside_s: float) -> None:
    """Write a run of `protocol` on the station in which each point takes `beside_s` more than planned."""
    at, before, lines = datetime(2026, 11, 20, tzinfo=UTC), None, [{"state": "run_started"}]
    for point in protocol.expand():
        lines.append({"t": at.isoformat(), "state": "started", "point": point.index})  # type: ignore[dict-item]
        at += timedelta(seconds=waits_s(point, changes_of(point, before)) + recording_s(point) + beside_s)
        file = f"points/{point.index:06d}.h5"
        lines.append({"t": at.isoformat(), "state": "done", "point": point.index, "file": file})  # type: ignore[dict-item]
        before = point
    (folder / "points").mkdir(parents=True)
    for i in range(len(lines) // 2):
        (folder / "points" / f"{i:06d}.h5").write_bytes(b"x")
    lines.append({"state": "run_finished"})
    (folder / "journal.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    header: dict[str, Any] = {
        "format": "evs-bench-run/1", "id": folder.name, "created": "2026-11-20T00:00:00Z",
        "sensor": {"name": "s", "width": 64, "height": 48}, "roi": {"x": 0, "y": 0, "width": 4, "height": 4},
        "station": {"name": "box"}, "protocol": protocol.resolved(),
    }  # fmt: skip
    (folder / "run.yaml").write_text(yaml.safe_dump(header))


def test_filters_by_hand_and_when(levels: Protocol, by_hand: Station) -> None:
    """Clear is asked for when the devices are connected; after two points of 61 s and the settling, OD 2."""
    foresight = check(levels, by_hand).foresight
    assert [(one.what, one.at_s) for one in foresight.changes_by_hand] == [("clear", 0.0), ("nd2", 2 * 61.0 + 6.0)]
    assert [(one.what, one.at_s) for one in foresight.operator_steps] == [
        ("Put the lens cap on.", 4 * 61.0 + 6.0 + 2.0)
    ]
    lines = check(levels, by_hand).lines()
    assert "by hand: 2 filters to put in: clear before it starts, nd2 at minute 2" in lines
    assert "by hand, minute 4: Put the lens cap on." in lines


def test_a_wheel_with_a_motor_asks_for_nobody(levels: Protocol, make_station: StationMaker) -> None:
    assert check(levels, make_station()).foresight.changes_by_hand == ()


def test_the_time_is_that_of_the_estimate_where_nothing_is_known_beside(
    levels: Protocol, by_hand: Station, protocol: LoadedProtocol
) -> None:
    for one in (levels, protocol.protocol):
        assert check(one, by_hand).foresight.duration_s == pytest.approx(one.estimate().duration_s)


def test_the_end_on_a_real_clock(levels: Protocol, by_hand: Station, tmp_path: Path) -> None:
    for i, seconds in enumerate((1.0, 1.5, 9.0)):
        _write_run(tmp_path / f"run-{i}", levels, seconds)
    before = datetime.now().astimezone()
    report = check(levels, by_hand, tmp_path)
    foresight = report.foresight
    assert foresight.pace is not None
    assert (foresight.pace.runs, foresight.pace.plain_s, foresight.pace.filter_s) == (3, 1.5, 1.5)
    assert foresight.duration_s == pytest.approx(levels.estimate().duration_s + 5 * 1.5)
    assert foresight.real_clock
    assert foresight.real_duration_s == foresight.duration_s
    assert timedelta(0) <= report.end - before - timedelta(seconds=foresight.duration_s) < timedelta(seconds=60)
    text = "\n".join(report.lines())
    assert f"it ends {report.end:%Y-%m-%d %H:%M} if it starts now" in text
    assert (
        "from 3 earlier runs on this station: 1.5 s beside each recording and its wait, 1.5 s with a change" in text
    )


def test_a_simulated_clock_has_two_times(levels: Protocol, make_station: StationMaker, tmp_path: Path) -> None:
    alone = check(levels, make_station(), tmp_path)
    assert alone.foresight.real_end is None
    assert "how long it computes is not known" in "\n".join(alone.lines())
    total_s = sum(recording_s(point) for point in levels.expand())
    _write_run(tmp_path / "run", levels, -60.0)  # a minute was recorded in no time
    report = check(levels, make_station(), tmp_path)
    assert not report.foresight.real_clock
    assert report.foresight.duration_s == pytest.approx(levels.estimate().duration_s)
    assert report.foresight.real_duration_s is not None
    assert 0.0 < report.foresight.real_duration_s < 0.1 * total_s
    assert "computes for about 8 s" in "\n".join(report.lines())
    assert json.loads(json.dumps(report.to_dict()["foresight"]["real_end"])) is not None


def test_contrasts_of_a_source_with_steps(make_station: StationMaker) -> None:
    """100 lux are 10 levels; a step of 1 level makes 11.05 to 11, 14.9 to 15, and 27.2 to 27."""
    station, points = make_station(), parse_protocol(STEPS, "s.yaml").protocol.expand()
    assert foresee(points, plan(points, station)[0], station, None).contrast is None
    station.light.level_step = 1.0
    worst = worst_contrast(plan(points, station)[0])
    assert worst is not None
    assert (worst.point, worst.asked_ln) == (0, 0.1)
    assert worst.set_ln == pytest.approx(math.log(1.1))
    assert str(worst) == "a log contrast of 0.1 becomes 0.09531 (-4.7 %)"
    report = check(parse_protocol(STEPS, "s.yaml").protocol, station)
    assert f"contrast: the worst is point 0 of m: {worst}" in report.lines()
    assert "contrast_in_steps" not in [finding.kind for finding in report.findings]


def test_a_contrast_that_is_another_one_is_a_warning(make_station: StationMaker) -> None:
    station = make_station()
    station.light.level_step = 2.0
    report = check(parse_protocol(STEPS, "s.yaml").protocol, station)
    found = next(finding for finding in report.findings if finding.kind == "contrast_in_steps")
    assert 0 in found.points
    assert "a log contrast of 0.1 becomes 0.1823 (+82 %)" in found.message


def test_a_contrast_into_darkness() -> None:
    error = ContrastError(3, "m", 0.5, math.nan)
    assert error.relative == math.inf
    assert str(error).endswith("needs a level below the lowest, which becomes darkness")


@pytest.mark.parametrize(
    ("level_step", "stimulus", "worst_points"),
    [
        (25.0, "{kind: square, frequency_hz: 5}", {0, 1, 2}),  # 10 levels become 0
        (12.0, "{kind: reset_test, polarity: off, reset_s: 0.1, test_s: 0.1, gap_s: 0.1, "
               "reset_contrast: {scale: log, value: 1.0}}", {2}),  # and 10 e^-1 where the rest are 12
    ],
)  # fmt: skip
def test_a_level_that_becomes_darkness_has_an_infinite_contrast(
    make_station: StationMaker, level_step: float, stimulus: str, worst_points: set[int]
) -> None:
    station, text = make_station(), STEPS.replace("{kind: square, frequency_hz: 5}", stimulus)
    station.light.level_step = level_step
    planned, _ = plan(parse_protocol(text, "s.yaml").protocol.expand(), station)
    assert {one.point.index for one in planned if math.isinf(one.log_contrast)} == worst_points
    assert str(worst_contrast(planned)).endswith("which becomes darkness")


def test_the_disk(
    levels: Protocol, make_station: StationMaker, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    new = tmp_path / "not" / "there" / "yet"
    report = check(levels, make_station(), new)
    assert report.foresight.free_bytes is not None
    assert not new.exists()
    assert f"free on the disk of {new}" in "\n".join(report.lines())
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=5))
    full = check(levels, make_station(), new)
    assert f"only 5 B free on the disk of {new}" in "\n".join(full.lines())
    assert check(levels, make_station()).foresight.free_bytes is None


def test_what_is_out_of_reach_is_told_in_few_lines(make_station: StationMaker) -> None:
    settings = ", ".join(f"{{on: {0.6 + 0.01 * i:.2f}, off: 0.3}}" for i in range(30))
    text = STEPS.replace("values: [0.1, 0.4, 1.0]", "values: [0.4]").replace(
        "illuminance_lux: [100]", f"illuminance_lux: [100, 5000]\n      thresholds: [{settings}]"
    )
    report = check(parse_protocol(text, "s.yaml").protocol, make_station())
    assert report.refused
    assert len(report.unreachable) == 60
    lines = report.lines()
    assert "out of reach: 60 of 60 points, for 31 reasons" in lines
    assert len([line for line in lines if line.startswith("error:")]) == 10
    assert "... and 21 more reasons: see --json" in lines
    assert len(report.to_dict()["findings"]) >= 31
