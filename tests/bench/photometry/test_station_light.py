"""A calibration of the light on its way into a station file."""

from __future__ import annotations

import datetime
import difflib
from importlib.resources import files
from typing import TYPE_CHECKING

import pytest
import yaml

from bench.photometry.meter import Reading, calibrate
from bench.photometry.station_light import NewLight, OfStation, new_light, of_station, write_light, yaml_text
from bench.station import load_station
from protocols.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

DATE = datetime.date(2026, 12, 1)
NEW = NewLight(
    {"lux_per_level": 0.0512, "date": DATE, "uncertainty": 0.021},
    {"nd30": {"transmission": 0.00093, "date": DATE, "uncertainty": 0.004}},
)
SHIPPED = files("bench").joinpath("stations", "simulated.yaml").read_text(encoding="utf-8")


@pytest.fixture
def station(tmp_path: Path) -> Path:
    path = tmp_path / "bench.yaml"
    path.write_text(SHIPPED, encoding="utf-8")
    return path


def changes(old: str, new: str) -> list[str]:
    lines = difflib.unified_diff(old.splitlines(), new.splitlines(), n=0, lineterm="")
    return [line for line in lines if line[0] in "+-" and line[:3] not in ("+++", "---")]


def test_only_what_was_measured_is_another(station: Path) -> None:
    kept = write_light(station, NEW)
    assert kept == station.with_name("bench.before.yaml")
    assert kept.read_text() == SHIPPED
    assert changes(SHIPPED, station.read_text()) == [
        "-    lux_per_level: 0.0483  # lux on the chip for each cd/m2, without a filter",
        "+    lux_per_level: 0.0512  # lux on the chip for each cd/m2, without a filter",
        "-    date: 2026-11-20",
        "-    uncertainty: 0.0",
        "+    date: 2026-12-01",
        "+    uncertainty: 0.021",
        "-    nd30: {nd_od: 3.0, transmission: 0.001}",
        "+    nd30: {nd_od: 3.0, transmission: 0.00093, date: 2026-12-01, uncertainty: 0.004}",
    ]
    calibration = load_station(str(station)).calibration
    assert (calibration.clear_lux_per_level, calibration.light_uncertainty) == (0.0512, 0.021)
    assert (calibration.filters["nd30"].transmission, calibration.filters["nd30"].uncertainty) == (0.00093, 0.004)
    assert (calibration.filters["nd10"].transmission, calibration.filters["nd10"].uncertainty) == (0.1, None)


def test_each_old_file_is_kept(station: Path) -> None:
    names = [write_light(station, NEW).name for _ in range(3)]
    assert names == ["bench.before.yaml", "bench.before-2.yaml", "bench.before-3.yaml"]
    assert sorted(path.name for path in station.parent.iterdir()) == sorted(["bench.yaml", *names])


def test_new_keys_stand_before_the_comment_of_what_comes_next(station: Path) -> None:
    old = SHIPPED.replace("    date: 2026-11-20\n    uncertainty: 0.0\n", "    # The filters of the wheel.\n")
    old = old.replace('"Simulated bench:', "'Simulated bench:").replace('of a sphere"', "of a sphere'")
    station.write_text(old)
    write_light(station, NEW)
    new = station.read_text()
    assert changes(old, new)[2:4] == ["+    date: 2026-12-01", "+    uncertainty: 0.021"]
    assert new.index("uncertainty: 0.021") < new.index("# The filters of the wheel.")
    assert "description: 'Simulated bench:" in new


def test_a_link_stays_a_link_and_lines_end_as_they_did(station: Path) -> None:
    link = station.with_name("link.yaml")
    link.symlink_to(station)
    station.write_bytes(SHIPPED.replace("\n", "\r\n").encode())
    write_light(link, NEW)
    assert link.is_symlink()
    data = station.read_bytes()
    assert data.count(b"\r\n") == data.count(b"\n")
    assert load_station(str(link)).calibration.clear_lux_per_level == 0.0512


def test_a_section_that_two_places_share_is_not_changed_for_both(station: Path) -> None:
    old = SHIPPED.replace("nd20: {nd_od: 2.0,", "nd20: &shared {nd_od: 2.0,")
    old = old.replace("nd30: {nd_od: 3.0, transmission: 0.001}", "nd30: {<<: *shared, nd_od: 3.0}")
    station.write_text(old)
    both = NewLight(NEW.light, {"nd20": {"transmission": 0.02}})
    with pytest.raises(InputError, match="cannot be changed without changing other values"):
        write_light(station, both)
    assert station.read_text() == old
    assert [path.name for path in station.parent.iterdir()] == ["bench.yaml"]


@pytest.mark.parametrize(
    ("old", "message"),
    [
        ("format: [\n", "bench.yaml:"),
        (SHIPPED.replace("lux_per_level: 0.0483", "lux_per_level: -1"), "bench.yaml:.*: calibration.light"),
        (SHIPPED.replace("nd30: {nd_od: 3.0", "nd30: {nd_od: 2.5"), "bench.yaml:.*nd_od: 2.5 is not"),
    ],
)
def test_a_file_that_is_no_station_is_left_alone(station: Path, old: str, message: str) -> None:
    station.write_text(old)
    with pytest.raises(InputError, match=message):
        write_light(station, NEW)
    assert station.read_text() == old
    assert [path.name for path in station.parent.iterdir()] == ["bench.yaml"]


def test_a_shipped_station_is_not_written() -> None:
    from pathlib import Path

    shipped = Path(str(files("bench").joinpath("stations", "simulated.yaml")))
    for path in (Path("simulated"), shipped):
        with pytest.raises(InputError, match="comes with the bench and is not written: copy it first"):
            write_light(path, NEW)
    assert shipped.read_text(encoding="utf-8") == SHIPPED


def test_what_is_printed_is_what_would_be_written() -> None:
    printed = yaml.safe_load(yaml_text(NEW))
    assert printed == {"light": NEW.light, "filters": NEW.filters}
    assert "&" not in yaml_text(NEW)


def measured(slope: float, behind: float, name: str = "nd10") -> list[Reading]:
    clear = [Reading(2 + i, level, slope * level, 1e-9, "clear") for i, level in enumerate((10.0, 100.0))]
    return [*clear, *[Reading(4 + i, level, behind * level, 1e-9, name) for i, level in enumerate((10.0, 100.0))]]


def test_a_clear_position_that_takes_light_is_reckoned_with() -> None:
    known = OfStation("%", {"open": 0.0, "nd10": 1.0}, "open", 0.9)
    new = new_light(calibrate(measured(0.45, 0.05), "r.csv"), known, DATE)
    assert new.light["lux_per_level"] == pytest.approx(0.5)
    # What reaches the chip behind the filter: level * lux_per_level * transmission.
    assert new.light["lux_per_level"] * new.filters["nd10"]["transmission"] == pytest.approx(0.05)


def test_filters_that_cannot_be_are_refused() -> None:
    known = of_station("simulated")
    assert (known.unit, known.clear_name, known.clear_transmission) == ("cd/m2", "clear", 1.0)
    with pytest.raises(InputError, match="no filter 'nd1' in the station; did you mean 'nd10'"):
        new_light(calibrate(measured(0.5, 0.05, "nd1"), "r.csv"), known, DATE)
    with pytest.raises(InputError, match=r"filter nd10: a transmission of 1\.2 is above 1"):
        new_light(calibrate(measured(0.5, 0.6), "r.csv"), known, DATE)
