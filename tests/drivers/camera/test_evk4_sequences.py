"""The registers that the driver writes, operation by operation, against the published sequences."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from drivers.camera.evk4.masks import mask_words
from drivers.errors import DeviceError
from drivers.interfaces import Recording
from protocols.points import Roi
from sim_backend.wire.evk4_registers import RegisterFile
from tests.drivers.camera.evk4_rigs import emulated

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sim_backend.wire.evk4_registers import Operation

_DOCUMENT = Path(__file__).parents[2] / "data" / "evk4" / "evk4_issd_openeb.json"
SEQUENCES: dict[str, list[dict[str, Any]]] = json.loads(_DOCUMENT.read_text(encoding="utf-8"))["sequences"]
NS_PER_US = 1000


@dataclass
class Expected:
    """A write that is expected: its value under a mask, and how long after the one before it must come."""

    address: int
    value: int
    mask: int
    wait_us: int


def expected(*names: str) -> Iterator[Expected]:
    """Yield the writes of published sequences."""
    wait_us = 0
    for name in names:
        for step in SEQUENCES[name]:
            kind = step["op"]
            if kind == "wait":
                wait_us += step["us"]
                continue
            for one in writes_of(step):
                one.wait_us = wait_us
                wait_us = 0
                yield one


def writes_of(step: dict[str, Any]) -> Iterator[Expected]:
    if step["op"] in ("write", "rmw"):
        mask = int(step.get("mask", "0xFFFFFFFF"), 16)
        yield Expected(int(step["addr"], 16), int(step["value"], 16), mask, 0)
    elif step["op"] in ("write_block", "write_block_formula"):
        for i in range(step["count"]):
            value = 2 * i + (2 * i + 1) * 65536 if "formula" in step else int(step["value"], 16)
            yield Expected(int(step["addr"], 16) + step["stride"] * i, value, 0xFFFFFFFF, 0)


def require_same(log: list[Operation], wanted: list[Expected]) -> list[Operation]:
    """Require that the writes in `log` begin with those wanted, and return the operations after them."""
    last_ns = log[0].time_ns
    stood: dict[int, int] = {}
    i = 0
    for at, operation in enumerate(log):
        if operation.kind == "read":
            stood[operation.address] = operation.value
            continue
        one = wanted[i]
        assert operation.address == one.address, f"write {i}"
        assert operation.value & one.mask == one.value & one.mask, f"write {i}"
        if one.mask != 0xFFFFFFFF:  # the bits outside are those that were read just before
            assert log[at - 1].kind == "read"
            assert operation.value & ~one.mask == stood[one.address] & ~one.mask, f"write {i}"
        assert operation.time_ns - last_ns >= one.wait_us * NS_PER_US, f"write {i}"
        last_ns = operation.time_ns
        i += 1
        if i == len(wanted):
            return log[at + 1 :]
    raise AssertionError(f"only {i} of {len(wanted)} writes came")


OPEN = ("stop", "destroy", "init", "post_init_monitoring", "facilities_after_init")


def test_the_document_is_the_whole_one() -> None:
    assert [len(SEQUENCES[name]) for name in ("init", "start", "stop", "destroy")] == [81, 5, 7, 27]
    assert len(list(expected("init"))) == 67


def test_open_is_what_is_published_and_then_what_a_measurement_wants() -> None:
    _, camera, usb = emulated()
    camera.connect()
    rest = require_same(usb.log, list(expected(*OPEN)))
    assert [(o.address, o.value) for o in rest if o.kind == "write"] == [
        (0xC000, 5), (0xD000, 5), (0x6050, 0), (0x7004, 0x400),
    ]  # fmt: skip
    read_back = [o.address for o in rest if o.kind == "read"]
    assert {0xC000, 0xD000, 0x6050, 0x7004} <= set(read_back)


def test_factory_codes_are_read_after_the_power_up_and_before_any_bias_is_written() -> None:
    _, camera, usb = emulated()
    camera.connect()
    addresses = [int(a, 16) for s in SEQUENCES["facilities_after_init"] for a in s.get("addrs", ())]
    reads = [o.address for o in usb.log if o.kind == "read" and o.address in addresses]
    assert reads == addresses
    assert [o.address for o in usb.log if o.kind == "write" and o.address in addresses] == [0x1014]  # by the init
    expected_codes = {"bias_fo": 83, "bias_hpf": 0, "bias_diff_on": 102, "bias_diff": 77, "bias_diff_off": 73}
    assert camera.factory_codes() == {**expected_codes, "bias_refr": 20}


def test_start_stop_and_close_are_what_is_published() -> None:
    bench, camera, usb = emulated()
    camera.connect()
    begin = len(usb.log)
    camera.start(Recording())
    assert not require_same([o for o in usb.log[begin:] if o.address < 0xC000], list(expected("start")))
    assert usb.state == "streaming"
    assert usb.queued_at_start == 1  # the stream is waited for before the sensor sends
    bench.world.clock.sleep(0.01)
    begin = len(usb.log)
    camera.stop()
    stopped_ns = bench.world.clock.now_ns
    assert not require_same(usb.log[begin:], list(expected("stop")))
    assert usb.state == "ready"
    assert stopped_ns - usb.log[-1].time_ns >= 300 * NS_PER_US  # what the sequence ends with
    begin = len(usb.log)
    camera.close()
    assert not require_same(usb.log[begin:], list(expected("destroy")))
    assert usb.state == "off"


def test_settings_change_the_registers_that_the_map_names_and_no_others() -> None:
    _, camera, usb = emulated()
    camera.connect()
    before = usb.register_values
    camera.set_roi(Roi(590, 310, 100, 100))
    camera.set_biases({"bias_diff_on": 20, "bias_diff_off": -10, "bias_refr": 100})
    after = usb.register_values
    changed = {address: after[address] for address in after if after[address] != before[address]}
    # Columns 590 to 689 and rows 310 to 409 are on: bit 14 of word 18 to bit 17 of word 21, bit 22 of word 9 to
    # bit 25 of word 12. A bit is 1 where the line is off.
    columns = {0x2000 + 4 * k: 0xFFFFFFFF for k in range(40) if not 18 <= k <= 21}
    columns |= {0x2048: 0x00003FFF, 0x2054: 0xFFFC0000}
    rows = {0x4000 + 4 * k: 0xFFFFFFFF for k in range(22) if not 9 <= k <= 12}
    rows |= {0x4024: 0x003FFFFF, 0x4030: 0xFC000000, 0x4058: before[0x4058] | 0xFFFF}
    biases = {0x1010: 0x11A10000 | 122, 0x1018: 0x11A10000 | 63, 0x1020: 0x11A10000 | 120}
    assert {a: v for a, v in changed.items() if a != 0x0004} == columns | rows | biases
    assert before[0x0004] & 0b1 << 10 == after[0x0004] & 0b1 << 10 == 0  # the pixels stay held
    assert after[0x0004] & 0b1000010 == 0b1000010


def test_open_leaves_what_is_published_but_for_the_filters_and_the_trigger() -> None:
    _, camera, usb = emulated()
    camera.connect()
    published, now_ns = RegisterFile(), 0
    for one in expected(*OPEN):
        now_ns += one.wait_us * NS_PER_US
        value = one.value
        if one.mask != 0xFFFFFFFF:
            value = published.read(one.address, now_ns) & ~one.mask | value & one.mask
        published.write(one.address, value, now_ns)
    differing = {a for a, v in usb.register_values.items() if v != published.values[a]}
    assert differing == {0xC000, 0xD000, 0x7004}


@pytest.mark.parametrize(("first", "count", "size"), [(0, 1280, 1280), (590, 100, 1280), (31, 2, 64), (719, 1, 720)])
def test_mask_words_say_which_lines_are_off(first: int, count: int, size: int) -> None:
    words = np.array(mask_words(first, count, size), "<u4")
    off = np.unpackbits(words.view(np.uint8), bitorder="little")[:size]
    assert np.flatnonzero(off == 0).tolist() == list(range(first, first + count))


@pytest.mark.parametrize("address", [0xC000, 0xD000, 0x6050])
def test_a_filter_that_does_not_go_off_is_refused(address: int, monkeypatch: pytest.MonkeyPatch) -> None:
    _, camera, usb = emulated()
    usb._firmware.registers.live[address] = lambda value: value ^ 0b1
    with pytest.raises(DeviceError, match=rf"switch the .* off: register 0x{address:X} reads"):
        camera.connect()
    assert not camera.connected


def test_a_filter_that_went_on_again_stops_the_next_recording() -> None:
    _, camera, usb = emulated()
    camera.connect()
    usb._firmware.registers.live[0xC000] = lambda _: 1
    with pytest.raises(DeviceError, match="anti-flicker filter"):
        camera.start(Recording())
    assert usb.state == "ready"
