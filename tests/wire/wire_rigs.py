"""Stations of simulated devices beside those of emulated wires, and how their answers are compared."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from bench.station import station_from

if TYPE_CHECKING:
    from bench.analysis.results import ResponseRow
    from bench.station import Station

DEVICE_TIMED = {
    "timing": "device", "lowest": 20, "highest": 60000, "unit": "count", "level_step": 1.0, "rise_tau_s": 1e-4,
    "settling_s": 1e-3,
}  # fmt: skip
HOST_TIMED = {
    "timing": "host", "lowest": 20.0, "highest": 15000.0, "unit": "cd/m2", "latency_s": 2e-3, "settling_s": 0.05,
}  # fmt: skip


def simulated_twin(wire: Station, light: dict[str, Any]) -> Station:
    """Return a station of simulated devices in the same world."""
    plan: dict[str, Any] = wire.resolved
    args = {k: v for k, v in plan["world"]["args"].items() if k not in ("filters", "bias_behaviour", "instruments")}
    filters = {name: section["nd_od"] for name, section in plan["calibration"]["filters"].items()}
    drivers = {
        "light": ("sim_backend.devices.light:SimulatedLightSource", light),
        "wheel": ("sim_backend.devices.filter_wheel:SimulatedFilterWheel", {"filters": filters}),
        "camera": ("sim_backend.devices.camera:SimulatedCamera", {"bias_behaviour": "$bias_map"}),
    }
    roles = {role: {"driver": d, "args": {"world": "$world", **given}} for role, (d, given) in drivers.items()}
    world = {"class": "sim_backend.world:OpticalBench", "args": args}
    return station_from({**plan, "world": world, "roles": {**roles, "clock": plan["roles"]["clock"]}}, "twin")


def shares_differ(a: ResponseRow, b: ResponseRow) -> float:
    """Return how likely two shares of answers are to be so far apart by chance, from the spread of their pixels."""
    shares = [row.per_pixel / row.pulses for row in (a, b)]
    variance = sum(share.var(ddof=1) / share.size for share in shares)
    off = abs(a.probability - b.probability)
    return 1.0 if off == 0.0 else math.erfc(off / math.sqrt(2.0 * variance))
