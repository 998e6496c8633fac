"""A sensor whose answers tests of alignment are about."""

from __future__ import annotations

from benchmarks.edge_alignment import Sensor

SENSOR = Sensor(
    pixels=100,
    theta_on=0.3,
    theta_off=0.25,
    mismatch=0.1,
    threshold_noise=0.02,
    pole_s=1e-4,
    dead_s=1e-3,
    delay_s=4e-5,
    jitter_s=2e-5,
    background_hz=1.0,
    rise_tau_s=1e-3,
)
