"""Waiting until a camera is warm, on a clock that costs no time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import pytest

from bench.queueing.schema import WarmUpSection
from bench.queueing.warm_up import warm_up
from bench.run.stop import StopFlag
from bench.station import load_station

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.station import Station


@pytest.fixture(name="station")
def simulated_station() -> Station:
    return load_station("simulated")


def warming(station: Station, temperature_c: Callable[[float], float], monkeypatch: pytest.MonkeyPatch) -> None:
    begin_s = station.clock.now()
    monkeypatch.setattr(station.camera, "temperature_c", lambda: temperature_c(station.clock.now() - begin_s))


def wait(station: Station, stop: StopFlag | None = None, **section: Any) -> Any:
    return warm_up(station, WarmUpSection(**section), stop or StopFlag(), lambda _: None)


def test_a_time_is_waited_with_the_light_dark(station: Station) -> None:
    done = wait(station, minutes=2.5)
    assert done.waited_s == pytest.approx(150.0)
    assert done.steady is None
    assert done.text() == "warmed up for 2.5 min, the sensor is at 25.0 degC"
    assert not station.light.connected
    assert not station.unsafe


def test_it_goes_on_when_the_temperature_stands_still(station: Station, monkeypatch: pytest.MonkeyPatch) -> None:
    tau_s, rise_c, limit = 120.0, 20.0, 0.5
    warming(station, lambda t: 45.0 - rise_c * math.exp(-t / tau_s), monkeypatch)
    done = wait(station, until_degc_per_minute=limit, at_most_minutes=60)
    last_minute = rise_c * math.exp(-done.waited_s / tau_s) * (math.exp(60.0 / tau_s) - 1.0)
    assert done.steady
    assert 0.8 * limit < last_minute < limit


@pytest.mark.parametrize(
    ("reading", "said"),
    [(lambda t: 25.0 + t, "does not stand still"), (lambda _: math.nan, "does not tell its temperature")],
)
def test_it_goes_on_at_the_latest_when_the_bound_is_reached(
    station: Station, monkeypatch: pytest.MonkeyPatch, reading: Callable[[float], float], said: str
) -> None:
    warming(station, reading, monkeypatch)
    done = wait(station, until_degc_per_minute=0.1, at_most_minutes=3)
    assert (done.steady, done.waited_s) == (False, pytest.approx(180.0))
    assert said in done.text()


def test_one_missing_reading_is_no_standstill(station: Station, monkeypatch: pytest.MonkeyPatch) -> None:
    warming(station, lambda t: math.nan if t > 45.0 else 25.0, monkeypatch)
    assert wait(station, until_degc_per_minute=0.1, at_most_minutes=2).steady is False


def test_the_operator_ends_it(station: Station, monkeypatch: pytest.MonkeyPatch) -> None:
    stop = StopFlag()
    sleep = station.clock.sleep

    def sleep_and_stop(seconds: float) -> None:
        sleep(seconds)
        if station.clock.now() > 30.0:
            stop.request()

    monkeypatch.setattr(station.clock, "sleep", sleep_and_stop)
    done = wait(station, stop, minutes=60)
    assert done.stopped
    assert done.waited_s < 40.0
