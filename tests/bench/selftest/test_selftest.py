"""The self test of a station: all good on the simulated one, and what is broken is found."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bench.selftest.whole import run_selftest
from bench.station import load_station
from drivers.errors import DeviceTimeout
from sim_backend.devices.camera import SimulatedCamera
from sim_backend.devices.filter_wheel import SimulatedFilterWheel
from sim_backend.world import OpticalBench

if TYPE_CHECKING:
    import pytest

    from bench.selftest.whole import SelfTest


def found() -> SelfTest:
    return run_selftest(load_station("simulated_ideal"))


def test_the_simulated_station_is_good() -> None:
    result = found()
    assert result.bad == 0
    assert {s.outcome for s in result.steps} == {"good"}
    assert {s.role for s in result.steps} == {"light", "wheel", "camera"}
    page = result.markdown()
    assert page.startswith("# Self test of station simulated_ideal")
    assert page.count("| good |") == len(result.steps)
    assert result.to_dict()["format"] == "evs-bench-selftest/1"


def test_what_is_broken_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wheel that does not move, triggers on an inverting input, and a dead time that rises."""
    monkeypatch.setattr(SimulatedFilterWheel, "selected", lambda _: "clear")
    emit = OpticalBench.emit_trigger
    monkeypatch.setattr(OpticalBench, "emit_trigger", lambda self, *, rising: emit(self, rising=not rising))
    rising = iter(np.linspace(1e-3, 2e-3, 1000))
    monkeypatch.setattr(SimulatedCamera, "refractory_s", lambda _: float(next(rising)))
    steps = {s.what: s for s in found().steps}
    assert steps["filter nd10"].outcome == "bad"
    assert steps["filter clear"].outcome == "good"
    assert steps["trigger input"].outcome == "look"
    assert "inverted" in steps["trigger input"].found
    assert steps["dead time against bias_refr"].outcome == "bad"


def test_a_device_that_fails_does_not_hide_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    def late(self: SimulatedCamera) -> float:
        raise DeviceTimeout(self.name, "read the temperature", "nothing within 1 s")

    monkeypatch.setattr(SimulatedCamera, "temperature_c", late)
    result = found()
    assert [s.found for s in result.steps if s.outcome == "bad"] == [
        "camera: read the temperature: nothing within 1 s"
    ]
    assert any(s.what == "nothing lost" for s in result.steps)
