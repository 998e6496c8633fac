"""Connecting, and every way out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bench.station import DevicesFailed, Station, load_station

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from drivers.errors import ConnectionFailed
    from tests.bench.station.conftest import Diary


@pytest.fixture(name="station")
def station_of_lab(write: Callable[..., Path]) -> Station:
    return load_station(str(write()))


def test_nothing_happens_before_connect(station: Station, diary: Diary) -> None:
    station.safe_state()
    station.close()
    assert diary.lines == []
    assert station.identities() == {}
    assert "identities" not in station.resolved


def test_connects_in_order_and_closes_in_reverse(station: Station, diary: Diary) -> None:
    with station:
        station.connect()
        assert [line for line in diary.lines if "connects" in line] == [
            "lamp connects",
            "wheel connects",
            "camera connects",
        ]
        diary.lines.clear()
    assert diary.lines[0] == "lamp safe"  # dark before anything is let go of
    assert [line for line in diary.lines if "closes" in line] == ["camera closes", "wheel closes", "lamp closes"]


def test_identities_are_kept_with_the_run(station: Station) -> None:
    with station:
        station.connect()
    lamp = {"maker": "lab", "model": "lamp", "serial": "1", "firmware": "2"}
    assert station.identities()["light"] == lamp
    assert station.resolved["identities"]["light"] == lamp


def test_all_devices_that_fail_are_told_and_the_others_closed(
    station: Station, diary: Diary, nobody_answers: Callable[[str], ConnectionFailed]
) -> None:
    diary.fail_at = {"lamp connects": nobody_answers("lamp"), "camera connects": nobody_answers("camera")}
    with pytest.raises(DevicesFailed) as caught:
        station.connect()
    assert str(caught.value).splitlines() == [
        "lamp: connect: nobody answers; is it switched on?",
        "camera: connect: nobody answers; is it switched on?",
    ]
    assert len(caught.value.failures) == 2
    assert caught.value.lines == tuple(str(caught.value).splitlines())
    assert diary.lines[-1] == "wheel closes"
    assert "lamp closes" not in diary.lines


def test_a_light_that_cannot_be_made_dark_is_not_connected(station: Station, diary: Diary) -> None:
    diary.fail_at = {"lamp safe": OSError("gone"), "wheel connects": OSError("busy")}
    with pytest.raises(DevicesFailed) as caught:
        station.connect()
    assert caught.value.lines == (
        "lamp: could not be made dark: gone; switch it off by hand",
        "wheel: connect: busy",
    )
    assert not station.light.connected
    assert [str(error) for error in station.unsafe] == [caught.value.lines[0]]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), RuntimeError("bug")])
def test_whatever_interrupts_connecting_the_light_ends_dark(station: Station, diary: Diary, error: Exception) -> None:
    diary.fail_at = {"camera connects": error}
    with pytest.raises(type(error)):
        station.connect()
    assert [line for line in diary.lines if "closes" in line] == ["wheel closes", "lamp closes"]


def test_leaving_with_an_error_closes_and_lets_the_error_pass(station: Station, diary: Diary) -> None:
    def use() -> None:
        with station:
            station.connect()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        use()
    assert diary.lines[-1] == "lamp closes"


def test_a_device_that_cannot_be_closed_does_not_stop_the_others(
    station: Station, diary: Diary, caplog: pytest.LogCaptureFixture
) -> None:
    station.connect()
    diary.fail_at = {"camera closes": OSError("gone"), "wheel safe": OSError("gone too")}
    station.close()
    assert [line for line in diary.lines if "closes" in line] == ["camera closes", "wheel closes", "lamp closes"]
    assert "camera: could not be closed" in caplog.text


def test_station_can_be_connected_again(station: Station, diary: Diary) -> None:
    station.connect()
    station.close()
    diary.lines.clear()
    station.connect()
    assert "lamp connects" in diary.lines
    station.close()


def test_light_is_dark_when_the_interpreter_exits(tmp_path: Path) -> None:
    import subprocess
    import sys

    code = (
        "import atexit\n"
        "from bench.station import load_station\n"
        "s = load_station('simulated')\n"
        "atexit.register(lambda: print(s.light.level()))\n"  # runs after what connect registers
        "s.connect()\n"
        "s.light.set_level(100.0)\n"
        "print(s.light.level())\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["100.0", "0.0"]
