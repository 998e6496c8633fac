"""Faults on the way to an EVK4, one in each recording: whatever is missing is said, and nothing is invented."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import pytest

from drivers.errors import ConnectionFailed, DeviceError
from drivers.interfaces import Recording, Waveform
from protocols.points import Roi
from sim_backend.wire.faults import Fault, FaultPlan
from tests.drivers.camera.evk4_rigs import Bench, emulated, read, simulated

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.wire.camera import WiredEvk4
    from sim_backend.wire.evk4_usb import Evk4Usb

ON_THE_WIRE = (Fault.REPLY_LOST, Fault.REPLY_LATE, Fault.REPLY_CUT, Fault.GARBAGE, Fault.UNPLUGGED)
ON_THE_STREAM = (Fault.OVERFLOW, Fault.TRIGGERS_MISSED, Fault.TRIGGERS_SWAPPED)
ROI = Roi(600, 300, 6, 5)
STEPS = Waveform(np.arange(0.0, 0.1, 0.02), np.array([1000.0, 2000.0] * 3)[:5], 0.1)
EDGES = 4
QUESTIONS = 75  #: about as many as a recording takes, from the window to the last reading


@dataclass
class Tally:
    """What came of the faults."""

    refused: Counter[Fault] = field(default_factory=Counter)
    flagged: Counter[Fault] = field(default_factory=Counter)
    unharmed: Counter[Fault] = field(default_factory=Counter)


def take(bench: Bench, seed: int) -> tuple[npt.NDArray[np.void], npt.NDArray[np.void]]:
    """Return a short recording of steps of the light."""
    camera = bench.camera
    camera.set_roi(ROI)
    camera.set_biases({"bias_diff_on": -20 if seed % 2 else 0})
    bench.light.set_level(1000.0)
    camera.start(Recording(seed=seed))
    bench.light.play(STEPS)
    camera.stop()
    return read(camera)


def recover(camera: WiredEvk4, error: DeviceError) -> None:
    """Do what an operator does after an error."""
    camera.safe_state()
    if camera.unsafe is not None or isinstance(error, ConnectionFailed):
        camera.close()
        while True:
            try:
                camera.connect()
            except ConnectionFailed:
                continue
            return


def uncovered(missing: npt.NDArray[np.void], gaps_s: tuple[tuple[float, float], ...]) -> int:
    """Return how many events are missing outside of the gaps."""
    t_s = missing["t"] / 1e6
    outside = np.ones(len(t_s), bool)
    for begin, end in gaps_s:
        outside &= (t_s < begin) | (t_s > end)
    return int(np.count_nonzero(outside))


def judge(
    camera: WiredEvk4,
    fault: Fault,
    found: tuple[npt.NDArray[np.void], npt.NDArray[np.void]],
    expected: tuple[npt.NDArray[np.void], npt.NDArray[np.void]],
    tally: Tally,
) -> None:
    """Require that all that is missing from a recording is said."""
    quality = camera.quality()
    events, triggers = found
    assert len(np.setdiff1d(events, expected[0])) == 0  # nothing is invented
    missing = np.setdiff1d(expected[0], events)
    sound = not (quality.decode_errors or quality.dropped_buffers or quality.overflows or quality.gaps_s)
    assert uncovered(missing, quality.gaps_s) <= quality.decode_errors
    assert not (sound and len(missing))
    if sound:
        np.testing.assert_array_equal(events, expected[0])
    if fault is Fault.TRIGGERS_SWAPPED:
        np.testing.assert_array_equal(triggers["p"], 1 - expected[1]["p"])
    elif fault is Fault.TRIGGERS_MISSED:
        assert len(np.setdiff1d(triggers, expected[1])) == 0  # the edges of the light tell how many are missing
    elif sound:
        np.testing.assert_array_equal(triggers, expected[1])
    (tally.unharmed if sound else tally.flagged)[fault] += 1


def run(n: int, seed: int) -> Tally:
    """Put `n` faults in, and return what came of them."""
    rng = np.random.default_rng(seed)
    bench, camera, usb = emulated(seed=seed)
    camera._link.timeout_s = 0.2
    reference = simulated()
    camera.connect()
    tally = Tally()
    for _ in range(n):
        fault = rng.choice(np.array([*ON_THE_WIRE, *ON_THE_STREAM], object))
        take_with(bench, camera, usb, reference, fault, int(rng.integers(QUESTIONS)), int(rng.integers(6)), tally)
    return tally


def take_with(
    bench: Bench,
    camera: WiredEvk4,
    usb: Evk4Usb,
    reference: Bench,
    fault: Fault,
    at: int,
    seed: int,
    tally: Tally,
) -> None:
    """Take a recording with a fault at the question `at`."""
    seconds = 0.01 if fault is Fault.UNPLUGGED else 0.05 * (at % 7)
    usb.faults.plan(FaultPlan(fault, at if fault in ON_THE_WIRE else 0, seconds=seconds))
    planned_until = usb.faults.requests + at
    try:
        found = take(bench, seed)
    except DeviceError as error:
        tally.refused[fault] += 1
        recover(camera, error)
        found = take(bench, seed)
        if fault is Fault.UNPLUGGED:
            usb._firmware.sensor.faults.clear()
    judge(camera, fault, found, take(reference, seed), tally)
    while usb.faults.requests <= planned_until:  # a fault that was planned for later does not befall the next one
        usb.faults.due()


def test_no_fault_goes_unnoticed() -> None:
    tally = run(40, seed=3)
    assert tally.refused[Fault.REPLY_LOST]
    assert tally.flagged[Fault.OVERFLOW]
    assert sum(tally.refused.values()) > 10


@pytest.mark.slow
def test_none_of_hundreds_of_faults_goes_unnoticed() -> None:
    tally = run(500, seed=11)
    for fault in ON_THE_WIRE:
        assert tally.refused[fault] > 10, fault
        assert not tally.flagged[fault]
    assert tally.flagged[Fault.OVERFLOW] > 40
    assert tally.unharmed[Fault.TRIGGERS_MISSED] > 40
    assert not any(tally.refused[fault] for fault in ON_THE_STREAM)
