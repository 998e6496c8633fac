"""The emulated camera takes the published sequences, and refuses what a real one would not survive."""

from __future__ import annotations

import errno
import json
from pathlib import Path

import pytest

from sim_backend.wire.evk4_registers import Refused, RegisterFile

_FOLDER = Path(__file__).parents[2] / "data" / "evk4"
SEQUENCES = json.loads((_FOLDER / "evk4_issd_openeb.json").read_text(encoding="utf-8"))["sequences"]
MAP = json.loads((_FOLDER / "evk4_registers.json").read_text(encoding="utf-8"))
OPEN = ("stop", "destroy", "init", "post_init_monitoring")


class Player:
    """Plays published sequences to a register file."""

    def __init__(self) -> None:
        self.registers = RegisterFile()
        self.now_ns = 0

    def play(self, *names: str, patience: float = 1.0, leave_out: int | None = None) -> None:
        """Play them, each wait times `patience`, without the step `leave_out`."""
        steps = [step for name in names for step in SEQUENCES[name]]
        for i, step in enumerate(steps):
            if i == leave_out:
                continue
            if step["op"] == "wait":
                self.now_ns += int(step["us"] * 1000 * patience)
                continue
            address, value = int(step["addr"], 16), int(step["value"], 16)
            if step["op"] == "rmw":
                mask = int(step["mask"], 16)
                value = self.registers.read(address, self.now_ns) & ~mask | value & mask
            self.registers.write(address, value, self.now_ns)


def test_registers_have_the_values_of_the_published_map() -> None:
    registers = RegisterFile({})
    for entry in MAP["registers"]:
        assert registers.values[int(entry["address"], 16)] == int(entry["map_default"], 16), entry["name"]
    for entry in MAP["arrays"]:
        first = int(entry["address"], 16)
        assert all(first + entry["stride"] * k in registers.values for k in range(entry["count"])), entry["name"]


def test_factory_codes_stand_in_the_low_byte() -> None:
    values = RegisterFile({0x1010: 102}).values
    assert values[0x1010] == 0x01A16366


def test_the_published_order_is_taken() -> None:
    player = Player()
    player.play(*OPEN)
    assert player.registers.state == "ready"
    player.play("start")
    assert player.registers.state == "streaming"
    player.play("stop")
    assert player.registers.state == "ready"
    player.play("destroy")
    assert player.registers.state == "off"


WRITES = [i for i, step in enumerate(SEQUENCES["init"]) if step["op"] == "write"]
TWICE = {i for i in WRITES if SEQUENCES["init"][i : i + 1] == SEQUENCES["init"][i + 1 : i + 2]}


@pytest.mark.parametrize("left_out", [i for i in WRITES if i not in TWICE and i != WRITES[-1]])
def test_a_power_up_without_one_of_its_steps_is_refused(left_out: int) -> None:
    player = Player()
    with pytest.raises(Refused) as refused:
        player.play("init", leave_out=left_out)
    assert refused.value.code == errno.EPROTO


@pytest.mark.parametrize("name", ["init", "destroy", "post_init_monitoring", "stop"])
def test_waits_that_are_too_short_are_refused(name: str) -> None:
    before = {"init": (), "destroy": (), "post_init_monitoring": ("init",), "stop": ("init", "start")}[name]
    waits = [i for i, step in enumerate(SEQUENCES[name]) if step["op"] == "wait"]
    assert waits
    for left_out in waits:
        player = Player()
        player.play(*before)
        at_the_end = all(step["op"] == "wait" for step in SEQUENCES[name][left_out:])
        if at_the_end:  # asked for by what comes next
            player.play(name, leave_out=left_out)
        with pytest.raises(Refused, match="too soon") as refused:
            player.play("destroy" if at_the_end else name, leave_out=None if at_the_end else left_out)
        assert refused.value.code == errno.EBUSY


def test_start_needs_a_power_up() -> None:
    player = Player()
    with pytest.raises(Refused):
        player.play("start")


def test_destroy_needs_a_stop() -> None:
    player = Player()
    player.play("init", "start")
    with pytest.raises(Refused):
        player.play("destroy")


def test_init_needs_a_destroy() -> None:
    player = Player()
    player.play("init")
    with pytest.raises(Refused):
        player.play("init")


def test_pixels_are_not_released_out_of_turn() -> None:
    player = Player()
    player.play("init")
    with pytest.raises(Refused):
        player.registers.write(0x0004, 0xF0005442, player.now_ns + 10**9)


def test_settings_need_power() -> None:
    registers = RegisterFile()
    with pytest.raises(Refused):
        registers.write(0x1010, 0x11A10066, 0)


def test_a_register_that_is_not_on_the_map_is_refused() -> None:
    with pytest.raises(Refused) as refused:
        RegisterFile().read(0x1234, 0)
    assert refused.value.code == errno.ENXIO


def test_a_sequence_that_broke_off_is_stopped_and_begun_anew() -> None:
    for broken in range(1, 80, 7):
        player = Player()
        steps = SEQUENCES["init"][:broken]
        for step in steps:
            if step["op"] == "wait":
                player.now_ns += step["us"] * 1000
            else:
                player.registers.write(int(step["addr"], 16), int(step["value"], 16), player.now_ns)
        player.now_ns += 10**6
        player.play(*OPEN)
        assert player.registers.state == "ready"
