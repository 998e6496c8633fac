"""The EVK4 driver on an emulated camera: the same events as the simulated one, all of them, or it says so."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from drivers.camera.evk4.spool import Spool
from drivers.errors import ConnectionFailed, DataLost, DeviceError, OutOfRange, WrongState
from drivers.events.encode import Evt3Encoder
from drivers.events.raw import open_recording
from drivers.events.types import EVENT_DTYPE, TRIGGER_DTYPE
from drivers.interfaces import Recording
from protocols.errors import InputError
from protocols.points import Roi
from sim_backend.wire.faults import Fault, FaultPlan
from tests.drivers.camera.evk4_rigs import emulated, read, simulated

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    from drivers.camera.evk4.evk4 import Evk4
    from protocols.points import Ambient

ROI = Roi(590, 310, 8, 6)


@pytest.mark.parametrize("seed", [1, 2, 77])
@pytest.mark.parametrize("biases", [{}, {"bias_diff_on": -40, "bias_diff_off": 30, "bias_refr": 100}])
def test_events_and_triggers_are_those_of_the_simulated_camera(seed: int, biases: dict[str, int]) -> None:
    wired, camera, _ = emulated()
    camera.connect()
    events, triggers = wired.record(ROI, seed, biases)
    expected_events, expected_triggers = simulated().record(ROI, seed, biases)
    np.testing.assert_array_equal(events, expected_events)
    np.testing.assert_array_equal(triggers, expected_triggers)
    assert len(events) > ROI.pixels
    assert len(triggers) == 9


def test_recordings_of_one_camera_are_those_of_the_simulated_one() -> None:
    wired, camera, _ = emulated()
    camera.connect()
    reference = simulated()
    ambients: tuple[tuple[int, Ambient], ...] = ((3, "open"), (4, "capped"), (3, "shrouded"), (3, "open"))
    for seed, ambient in ambients:
        taken = []
        for bench in (wired, reference):
            bench.camera.set_roi(ROI)
            bench.camera.start(Recording(seed=seed, ambient=ambient))
            bench.flicker()
            bench.camera.stop()
            taken.append(read(bench.camera))
        np.testing.assert_array_equal(taken[0][0], taken[1][0])
        np.testing.assert_array_equal(taken[0][1], taken[1][1])


def stream(n: int, first_step: int = 0) -> tuple[bytes, npt.NDArray[np.void], npt.NDArray[np.void]]:
    """Return words, and the events and triggers in them."""
    rng = np.random.default_rng(1)
    events = np.empty(n, EVENT_DTYPE)
    events["t"] = np.sort(rng.integers(0, 100_000, n))
    events["x"], events["y"], events["p"] = (rng.integers(0, high, n) for high in (1280, 720, 2))
    triggers = np.zeros(20, TRIGGER_DTYPE)
    triggers["t"] = np.arange(20) * 5000
    words = np.frombuffer(Evt3Encoder(1280, 720).feed(events, triggers), "<u2").copy()
    is_high = words >> 12 == 8
    words[is_high] = 0x8000 | (words[is_high] + first_step) & 0xFFF
    return words.tobytes(), events, triggers


@pytest.mark.parametrize("transfer_bytes", [1024, 131072])
@pytest.mark.parametrize("first_step", [0, 4090])
def test_a_stream_arrives_complete(transfer_bytes: int, first_step: int) -> None:
    bench, camera, usb = emulated(transfer_bytes=transfer_bytes, transfers=4096)
    camera.connect()
    data, events, triggers = stream(200_000, first_step)
    usb.replay(data)
    camera.start(Recording())
    bench.world.clock.sleep(0.1)
    camera.stop()
    for _ in range(2):  # it can be read again
        found, found_triggers = read(camera)
        np.testing.assert_array_equal(found, events)
        np.testing.assert_array_equal(found_triggers, triggers)
    quality = camera.quality()
    assert quality.bytes_received == len(data)
    assert (quality.decode_errors, quality.dropped_buffers, quality.overflows, quality.gaps_s) == (0, 0, 0, ())


def test_a_computer_that_falls_behind_loses_whole_transfers_and_says_which(monkeypatch: pytest.MonkeyPatch) -> None:
    bench, camera, usb = emulated(transfer_bytes=1024, transfers=4)
    camera.connect()
    data, events, _ = stream(20_000)
    enough, again = threading.Event(), threading.Event()
    write, reads = Spool.write, usb.bulk_read

    def slow(spool: Spool, some: memoryview) -> None:
        if spool.size >= 10 * 1024:
            assert enough.wait(10.0)
        write(spool, some)
        if enough.is_set():
            again.set()

    def counting(handle: Any, ep: int, *rest: Any) -> int:
        if ep == 0x81 and camera._running is not None and camera._running.reader.dropped_transfers == 15:
            enough.set()
            assert again.wait(10.0)
        size: int = reads(handle, ep, *rest)
        return size

    monkeypatch.setattr(Spool, "write", slow)
    monkeypatch.setattr(usb, "bulk_read", counting)
    usb.replay(data)
    camera.start(Recording())
    assert again.wait(10.0)
    bench.world.clock.sleep(0.1)
    camera.stop()
    found, _ = read(camera)
    quality = camera.quality()
    assert quality.dropped_buffers >= 15
    assert quality.bytes_received == len(data)
    assert quality.gaps_s
    missing = np.setdiff1d(events, found)
    assert len(missing) > 1000
    assert len(np.setdiff1d(found, events)) == 0
    t_s = missing["t"] / 1e6
    uncovered = np.ones(len(t_s), bool)
    for begin, end in quality.gaps_s:
        uncovered &= (t_s < begin) | (t_s > end)
    assert np.count_nonzero(uncovered) <= quality.decode_errors


def test_a_disk_without_room_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    bench, camera, usb = emulated()
    camera.connect()

    def full(spool: Spool, some: memoryview) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as broken:
        broken.setattr(Spool, "write", full)
        usb.replay(stream(1000)[0])
        camera.start(Recording())
        bench.world.clock.sleep(0.1)
        with pytest.raises(DataLost, match="No space left on device; make room"):
            camera.stop()
    assert camera.quality().dropped_buffers == 1
    assert camera.quality().gaps_s == ((0.0, 0.1),)
    events, _ = bench.record(ROI)
    assert len(events) > 0


def test_recordings_are_kept_as_raw_files(tmp_path: Path) -> None:
    bench, camera, _ = emulated(raw_folder=tmp_path / "raw")
    camera.connect()
    events, triggers = bench.record(ROI)
    camera.start(Recording(label="S-curve 3/a"))
    assert (tmp_path / "raw" / "S-curve_3_a.raw.part").exists()
    bench.flicker()
    camera.stop()
    bench.record(ROI)
    names = sorted(p.name for p in (tmp_path / "raw").iterdir())
    assert names == ["S-curve_3_a.raw", "recording-2.raw", "recording.raw"]
    kept = open_recording(tmp_path / "raw" / "recording.raw")
    assert (kept.format, kept.width, kept.height) == ("EVT3", 1280, 720)
    chunks = list(kept.chunks())
    np.testing.assert_array_equal(np.concatenate([c.events for c in chunks]), events)
    np.testing.assert_array_equal(np.concatenate([c.triggers for c in chunks]), triggers)
    camera.close()
    assert len(list((tmp_path / "raw").iterdir())) == 3


def test_an_old_reading_ends_when_a_new_recording_starts() -> None:
    bench, camera, usb = emulated()
    camera.connect()
    usb.replay(stream(1_000_000)[0])
    camera.start(Recording())
    bench.world.clock.sleep(0.1)
    camera.stop()
    chunks = camera.chunks()
    next(chunks)
    camera.start(Recording())
    with pytest.raises(WrongState, match="read it before the next start"):
        list(chunks)
    camera.stop()


def test_a_code_that_a_byte_cannot_hold_is_refused() -> None:
    _, camera, usb = emulated()
    assert camera.bias_limits["bias_diff_off"].highest == 190
    camera.connect()
    assert camera.bias_limits["bias_diff_off"].highest == 182  # this unit came with code 73
    before = usb.register_values
    with pytest.raises(OutOfRange, match="bias_diff_off to 183"):
        camera.set_biases({"bias_diff_off": 183})
    camera.bias_limits = {**camera.bias_limits, "bias_diff_off": emulated()[1].bias_limits["bias_diff_off"]}
    with pytest.raises(OutOfRange, match="allowed is -73 to 182"):
        camera.set_biases({"bias_diff_on": 5, "bias_diff_off": 190})
    assert usb.register_values == before


def test_a_bias_that_does_not_read_back_is_said() -> None:
    _, camera, usb = emulated()
    camera.connect()
    usb._firmware.registers.live[0x1010] = lambda _: 102
    with pytest.raises(DeviceError, match="set bias_diff_on to code 112: it reads back as 102"):
        camera.set_biases({"bias_diff_on": 10})


def test_what_the_sensor_measures_of_itself() -> None:
    bench, camera, _ = emulated()
    camera.connect()
    bench.world.temperature_c = 41.0
    assert camera.temperature_c() == pytest.approx(41.0, abs=0.1)
    assert camera.refractory_s() == pytest.approx(5e-3, abs=5e-9)
    camera.set_biases({"bias_refr": 100})
    assert camera.refractory_s() == pytest.approx(5e-3 * 0.98**100, abs=5e-9)
    bench.light.set_level(400.0)
    assert camera.illumination_lux() == pytest.approx(20.0, rel=1e-3)
    assert camera.illumination_counter() == pytest.approx(854_658 / 20.0, rel=1e-3)
    bench.light.set_level(0.0)
    assert camera.illumination_counter() is None
    assert np.isnan(camera.illumination_lux())


def test_readings_during_a_recording_do_not_disturb_it() -> None:
    wired, camera, _ = emulated()
    camera.connect()
    camera.set_roi(ROI)
    camera.start(Recording(seed=5))
    begin_ns = wired.world.clock.now_ns
    wired.flicker()
    assert camera.temperature_c() == pytest.approx(25.0, abs=0.1)
    assert camera.refractory_s() == pytest.approx(5e-3)
    assert wired.world.clock.now_ns - begin_ns == 500_000_000
    camera.stop()
    reference = simulated()
    reference.camera.set_roi(ROI)
    reference.camera.start(Recording(seed=5))
    reference.flicker()
    reference.camera.stop()
    np.testing.assert_array_equal(read(camera)[0], read(reference.camera)[0])


def failure(camera: Evk4) -> DeviceError | None:
    """Return what the last safe state could not do."""
    return camera.unsafe


def test_a_camera_that_is_unplugged_while_it_records_says_so_and_can_be_used_again() -> None:
    bench, camera, usb = emulated()
    camera.connect()
    camera.start(Recording())
    bench.flicker()
    usb.unplug(0.0)
    with pytest.raises(ConnectionFailed, match="No such device"):
        camera.stop()
    camera.safe_state()
    assert failure(camera) is not None
    camera.close()
    camera.connect()
    assert failure(camera) is None
    events, _ = bench.record(ROI)
    assert len(events) > ROI.pixels


def test_a_recording_that_cannot_be_stopped_at_once_can_be_stopped_later() -> None:
    bench, camera, usb = emulated()
    camera.connect()
    camera.set_roi(ROI)
    camera.start(Recording(seed=6))
    bench.flicker()
    usb.faults.plan(FaultPlan(Fault.REPLY_LOST, 3))
    with pytest.raises(DeviceError):
        camera.stop()
    camera.safe_state()
    assert camera.unsafe is None
    assert usb.state == "ready"
    events, _ = read(camera)
    reference = simulated()
    np.testing.assert_array_equal(events, reference.record(ROI, seed=6)[0])


def test_a_start_that_fails_leaves_the_sensor_stopped() -> None:
    _, camera, usb = emulated()
    camera.connect()
    usb.faults.plan(FaultPlan(Fault.REPLY_LOST, 8))
    with pytest.raises(DeviceError):
        camera.start(Recording())
    assert usb.state == "ready"
    camera.start(Recording())
    camera.stop()


def test_a_disturbed_power_up_lets_go_of_the_camera() -> None:
    bench, camera, usb = emulated()
    for at in (0, 1, 2, 10, 200, 600, 700):
        usb.faults.plan(FaultPlan(Fault.REPLY_LOST, at))
        with pytest.raises(DeviceError):
            camera.connect()
        assert not camera.connected
    camera.connect()
    assert len(bench.record(ROI)[0]) > 0


@pytest.mark.parametrize("arguments", [{"transfer_bytes": 1000}, {"transfer_bytes": 0}, {"transfers": 1}])
def test_buffers_that_make_no_sense_are_refused(arguments: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"camera: transfer"):
        emulated(**arguments)
