"""`evs-bench photometry`."""

from __future__ import annotations

import json
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import pytest
from click.testing import CliRunner

from bench import cli
from bench.commands.photometry import command
from bench.station import load_station
from protocols.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

READINGS = """\
level,lux,filter
0,0.21,
500,24.6,
1000,49.1,
2000,97.6,
4000,195.5,
8000,392,
15000,602,
8000,37.6,nd10
12000,56.2,nd10
15000,70.6,nd10
"""
LENS = ("lens", "--f-number", "2", "--transmittance", "0.9")
SENSOR = ("--pitch-um", "4.86", "--photons-per-lux", "1.12e16")
DATE = ("--date", "2026-12-01")


def invoke(*arguments: str) -> str:
    result = CliRunner().invoke(command, list(arguments), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


def numbers(*arguments: str) -> dict[str, Any]:
    printed: dict[str, Any] = json.loads(invoke(*arguments, "--json"))
    assert printed["format"] == "evs-bench-photometry/1"
    assert "command" not in printed or printed["command"] == arguments[0]
    return printed


@pytest.fixture(name="folder")
def folder_of_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "readings.csv").write_text(READINGS)
    shipped = files("bench").joinpath("stations", "simulated.yaml")
    (tmp_path / "bench.yaml").write_text(shipped.read_text(encoding="utf-8"))
    return tmp_path


def test_lux_behind_a_lens_and_before_a_port() -> None:
    assert numbers(*LENS, "--luminance", "15000")["lux"] == pytest.approx(2650, rel=1e-3)
    assert numbers(*LENS, "--luminance", "15000", "--transmission", "0.001")["lux"] == pytest.approx(2.65, rel=1e-3)
    near = numbers(*LENS, "--luminance", "1", "--magnification", "1")
    assert near["lux"] == pytest.approx(0.1767 / 4.0, rel=1e-3)
    scene = numbers(*LENS, "--scene-lux", "100", "--reflectance", "0.18")
    assert scene["lux"] == pytest.approx(100.0 * 0.18 * 0.9 / (4.0 * 2.0**2))
    assert scene["asked"]["scene_lux"] == 100.0
    for distance, lux in ((0, 47100), (100, 5810), (300, 725), (1000, 66)):
        found = numbers("bare", "--distance-mm", str(distance), "--port-radius-mm", "37.5", "--luminance", "15000")
        assert found["lux"] == pytest.approx(lux, rel=5e-3)
    assert "on the chip    2.651 lux" in invoke(*LENS, "--luminance", "15000", "--transmission", "0.001")


def test_spectrum() -> None:
    found = numbers("spectrum", "D65", "--range", "380", "780")
    assert found["photons_per_lux"] == pytest.approx(1.39e16, rel=0.01)
    assert found["quantum_efficiency"] is None
    # 42.4 fA per lux times eta at 1.12e16 photons and 4.86 um.
    found = numbers("spectrum", "blackbody", "5800", "--qe", "0.6", "--pitch-um", "4.86")
    assert found["current_fa_per_lux"] == pytest.approx(42.39 * 0.6 * found["photons_per_lux"] / 1.12e16, rel=1e-3)
    told = invoke("spectrum", "blackbody 5800", "--qe", "0.6", "--pitch-um", "4.86")
    for part in ("1.095e+16 per m2 and s", "251 lm/W", "0.6 (mean", "24.87 fA per lux", "61% of its photons"):
        assert part in told
    assert {"A", "D65", "LED-B3"} <= set(numbers("spectrum", "--list")["names"])
    assert "mono NANOMETRES" in invoke("spectrum", "--list")


def test_spectrum_and_efficiency_from_files(folder: Path) -> None:
    (folder / "light.csv").write_text("wavelength_nm,power\n500,1\n600,1\n")
    (folder / "qe.csv").write_text("wavelength_nm,qe\n400,0.5\n700,0.8\n")
    told = invoke("spectrum", "light.csv", "--range", "500", "600", "--qe", "qe.csv")
    assert "quantum efficiency   0.65" in told
    assert "warning: the spectrum ends at 500 nm" in told
    (folder / "qe.csv").write_text("wavelength_nm,qe\n400,50\n700,80\n")
    with pytest.raises(InputError, match=r"qe.csv:2:5: qe: expected a number up to 1, found 50"):
        invoke("spectrum", "D65", "--qe", "qe.csv")


def test_efficiency() -> None:
    claims = ("5.55+-0.28,0.076,0.8,0.35", "5.62,0.080,100%,0.25")
    told = invoke("efficiency", *claims, *SENSOR)
    for part in (
        "146.3",
        "6.199",
        "0.895 +- 0.045",
        "201.7",
        "8.547",
        "0.658",
        "do not follow from one eta",
        "30.6%",
    ):
        assert part in told
    found = numbers("efficiency", *claims, *SENSOR)
    assert [claim["eta"] for claim in found["claims"]] == pytest.approx([0.895, 0.6575], abs=5e-4)
    assert [pair["one_eta"] for pair in found["pairs"]] == [False]
    assert "above 1: the current does not belong to this light" in invoke("efficiency", "20,0.076,0.8,0.35", *SENSOR)
    agree = invoke("efficiency", claims[0], "5.6,0.076,0.8,0.35", *SENSOR)
    assert "may follow from one eta" in agree


def test_meter_without_a_station(folder: Path) -> None:
    told = invoke("meter", "readings.csv")
    for part in ("0.04738 +- 0.0015", "own error is not in it", "0.21 lux", "not read behind nd10", "--leave-out 8"):
        assert part in told
    found = numbers("meter", "readings.csv", "--leave-out", "8", "--meter-uncertainty", "0.02")
    assert found["lux_per_level"] == pytest.approx(0.048832, rel=1e-4)
    assert found["lux_per_level_sd"] / found["lux_per_level"] == pytest.approx(0.02, rel=0.01)
    assert found["filters"]["nd10"]["transmission"] == pytest.approx(0.0962, rel=1e-3)
    assert (found["odd_lines"], found["calibration"], found["written"]) == ([], None, None)


def test_meter_prints_what_belongs_into_the_station_and_writes_it(folder: Path) -> None:
    before = (folder / "bench.yaml").read_text()
    arguments = ("meter", "readings.csv", "--leave-out", "8", "--station", "bench.yaml", *DATE)
    told = invoke(*arguments)
    for part in (
        "lux per cd/m2",
        "nominal 10^-OD 0.1",
        "below `calibration:` of bench.yaml",
        "    lux_per_level: 0.0488",
    ):
        assert part in told
    assert (folder / "bench.yaml").read_text() == before
    found = numbers(*arguments, "--write")
    assert found["written"] == {"station": "bench.yaml", "before": "bench.before.yaml"}
    calibration = load_station("bench.yaml").calibration
    assert calibration.clear_lux_per_level == found["calibration"]["light"]["lux_per_level"]
    assert calibration.light_uncertainty == found["calibration"]["light"]["uncertainty"]
    assert (folder / "bench.before.yaml").read_text() == before


def test_readings_through_the_clear_position_are_without_a_filter(folder: Path) -> None:
    text = (folder / "bench.yaml").read_text().replace("clear: ", "open: ").replace("{clear:", "{open:")
    (folder / "bench.yaml").write_text(text)
    (folder / "readings.csv").write_text("level,lux,filter\n100,5.0,open\n200,10.1,\n")
    found = numbers("meter", "readings.csv", "--station", "bench.yaml", *DATE)
    assert (found["readings"], found["filters"]) == (2, {})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((*LENS,), "give the scene either by --luminance, or by"),
        ((*LENS, "--luminance", "1", "--scene-lux", "1", "--reflectance", "1"), "give the scene either"),
        ((*LENS, "--scene-lux", "1"), "give the scene either"),
        ((*LENS, "--luminance", "nan"), "expected a finite number"),
        ((*LENS, "--luminance", "inf"), "expected a finite number"),
        (("lens", "--f-number", "0", "--transmittance", "0.9", "--luminance", "1"), "--f-number"),
        (("lens", "--f-number", "2", "--transmittance", "1.1", "--luminance", "1"), "--transmittance"),
        (("lens", "--f-number", "2", "--luminance", "1"), "--transmittance"),
        (("spectrum",), "name a spectrum or a file"),
        (("spectrum", "D65", "--pitch-um", "5"), "--pitch-um needs --qe"),
        (("spectrum", "D65", "--qe", "1.5"), "expected a number above 0 and up to 1"),
        (("spectrum", "D65", "--qe", "none.csv"), "none.csv: cannot be read"),
        (("spectrum", "D65", "--range", "700", "400"), "expected LOW below HIGH"),
        (("spectrum", "D66"), "did you mean"),
        (("spectrum", "none.csv"), "none.csv: cannot be read"),
        (("efficiency", "1,2,3,0.3"), "--pitch-um"),
        (("efficiency", "1,2,3,0.3", "--pitch-um", "5"), "--photons-per-lux"),
        (("efficiency", "1,2", *SENSOR), "claim '1,2': expected FA"),
        (("meter", "readings.csv", "--write"), "--write needs --station FILE"),
        (("meter", "readings.csv", "--station", "bench.yaml"), "--station needs --date"),
        (("meter", "readings.csv", "--station", "simulated", *DATE, "--write"), "comes with the bench"),
        (("meter", "readings.csv", "--station", "nowhere", *DATE), "there is no station 'nowhere'"),
        (("meter", "readings.csv", "--leave-out", "99"), "line 99 holds no reading"),
        (("meter", "none.csv"), "none.csv: cannot be read"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_mistakes_are_one_line(
    folder: Path, arguments: tuple[str, ...], message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    there = sorted(folder.iterdir())
    assert cli.run(["photometry", *arguments]) == 1
    out, err = capfd.readouterr()
    assert out == ""
    assert len(err.splitlines()) == 1, err
    assert message in err
    assert sorted(folder.iterdir()) == there
