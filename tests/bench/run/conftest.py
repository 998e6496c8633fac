"""A small simulated station, built from its parts, and a protocol to run on it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pytest

from bench.station import BiasMap, Calibration, Station
from bench.station.bias_map import BiasCurve
from bench.station.calibration import CalibratedFilter
from bench.store.data import Sensor
from protocols import LoadedProtocol, parse_protocol
from sim_backend.devices.camera import SimulatedCamera
from sim_backend.devices.clock import SimulatedClock
from sim_backend.devices.filter_wheel import SimulatedFilterWheel
from sim_backend.devices.light import SimulatedLightSource
from sim_backend.world import OpticalBench

if TYPE_CHECKING:
    from drivers.interfaces import LightSource

PROTOCOL = """\
format: evs-bench-protocol/1
title: a small run
seed: 5
roi: {x: 10, y: 20, width: 4, height: 3}
expect: {theta_on: 0.3, theta_off: 0.25, dark_light_lux: 0.1, bandwidth_hz: 200, refractory_period_s: 0.005}
pulses: 3
measurements:
  - name: "square"
    stimulus: {kind: square, frequency_hz: 5}
    sweep:
      illuminance_lux: [100]
      contrast: {scale: log, values: [0.5, 1.0]}
  - name: "on"
    stimulus: {kind: reset_test, polarity: "on", reset_s: 0.04, test_s: 0.04,
               reset_contrast: {scale: log, value: 0.6}}
    sweep:
      illuminance_lux: [0.5]
      nd_od: [2]
      contrast: {scale: log, values: [0.6]}
  - name: "dark"
    stimulus: {kind: constant, duration_s: 0.5}
    sweep: {illuminance_lux: [100]}
    settings: {biases: {bias_diff_on: 20}}
"""

_CURVES = (
    BiasCurve("theta_on", "bias_diff_on", "linear", (-40, 80), (0.2, 0.5)),
    BiasCurve("theta_off", "bias_diff_off", "linear", (-40, 80), (0.15, 0.45)),
    BiasCurve("refractory_s", "bias_refr", "log", (-20, 235), (0.02, 0.0001)),
    BiasCurve("bandwidth_hz", "bias_fo", "log", (-35, 55), (100.0, 2000.0)),
)
_FILTERS = {"clear": 0.0, "nd2": 2.0}

StationMaker = Callable[..., Station]


def build_station(
    *,
    timing: str = "device",
    noise_rms: float = 0.04,
    light: Any = SimulatedLightSource,
    camera: Any = SimulatedCamera,
    trigger_cable: bool = True,
) -> Station:
    """Return a small simulated station; `light` and `camera` are the classes of its devices."""
    world = OpticalBench(
        lux_per_level=10.0, pixel={"noise_rms": noise_rms}, sensor_seed=3, trigger_cable=trigger_cable
    )
    biases = BiasMap(_CURVES)
    source: LightSource = light(
        world, lowest=0.5, highest=100.0, unit="%", timing=timing, rise_tau_s=1e-4, settling_s=2e-3, latency_s=3e-4
    )
    calibrated = {name: CalibratedFilter(od, 10.0**-od) for name, od in _FILTERS.items()}
    return Station(
        name="box",
        light=source,
        wheel=SimulatedFilterWheel(world, filters=_FILTERS),
        camera=camera(world, bias_behaviour=biases, width=64, height=48, dt_s=1e-4),
        clock=SimulatedClock(world),
        calibration=Calibration(10.0, source.limits, calibrated, biases),
        sensor=Sensor("simulated", 64, 48, 4.86e-6, 0.6),
        plan={"name": "box"},
    )


@pytest.fixture
def make_station() -> StationMaker:
    """Return a maker of small simulated stations of 64 x 48 pixels."""
    return build_station


@pytest.fixture
def protocol() -> LoadedProtocol:
    """Return a protocol of four points: two square waves, a reset/test behind a filter, one constant."""
    return parse_protocol(PROTOCOL, "small_run.yaml")
