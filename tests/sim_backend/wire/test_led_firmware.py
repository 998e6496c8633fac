"""The emulated LED driver answers with the bytes that its document says, and lights the world."""

from __future__ import annotations

import pytest

from drivers.light.led_protocol import encode_line
from sim_backend.wire.led_driver import LedFirmware
from sim_backend.world import OpticalBench


def bench() -> OpticalBench:
    return OpticalBench(lux_per_level=0.05, pixel={"noise_rms": 0.03, "theta_off": 0.25}, sensor_seed=5)


@pytest.fixture(name="firmware")
def firmware_in_a_world() -> LedFirmware:
    return LedFirmware(bench(), rise_tau_s=2e-5, max_edges=8)


def talk(firmware: LedFirmware, data: bytes) -> bytes:
    buffer, sent = bytearray(data), bytearray()
    for request in firmware.requests_in(buffer):
        firmware.obey(request, sent.extend)
    return bytes(sent)


def ask(firmware: LedFirmware, *texts: str) -> list[str]:
    """Return the answers without number and checksum."""
    answers = []
    for number, text in enumerate(texts, 1):
        sent = talk(firmware, encode_line(f"{number} {text}")).decode()
        answers += [line.partition("*")[0].partition(" ")[2] for line in sent.splitlines()]
    return answers


def test_hello_is_answered_byte_for_byte(firmware: LedFirmware) -> None:
    assert talk(firmware, b"1 hello*E648\n") == (
        b"1 ok evs-led protocol=1 firmware=1.0 serial=emulated "
        b"tick_us=1 dac_bits=16 max_edges=8 shortest_us=20*4559\n"
    )
    assert talk(firmware, b"1 hello*E647\n") == b"? error 1 garbled*3451\n"
    assert talk(firmware, b"1 hel") == b""


def test_levels_light_the_world(firmware: LedFirmware) -> None:
    assert ask(firmware, "level 1000", "level?", "dark", "level?") == ["ok 1000", "ok 1000", "ok 0", "ok 0"]
    ask(firmware, "level 1000")
    assert firmware._world.lux() == 50.0
    assert firmware._world.rise_tau_s == 2e-5


def test_errors_are_those_of_the_document(firmware: LedFirmware) -> None:
    wave = "wave 10 2 0 2 3 1000"
    assert ask(firmware, "fly", "level x", "level 65536", "wave 1 9 0 1 1 0", "play 1 1", wave, "play 6 1") == [
        "error 2 unknown command",
        "error 3 bad argument",
        "error 4 out of range",
        "error 5 too many edges",
        "error 6 no whole waveform",
        "ok 0",
        "error 6 no whole waveform",
    ]
    assert ask(firmware, "edges 0 100:20 50:10", "play 6 1449") == ["ok 2", "error 7 not the waveform that is stored"]


def test_a_waveform_is_played_to_the_microsecond(firmware: LedFirmware) -> None:
    world = firmware._world
    world.clock.sleep(1.0)
    begin_ns = world.clock.now_ns
    stored = ask(firmware, "wave 10 3 0 2 2 1000", "edges 0 100:20 50:10 30:30", "play 5 1330")
    assert stored == ["ok 0", "ok 3", "ok", "done 5 0"]
    assert world.clock.now_ns == begin_ns + 1_330_000
    history = world.light(begin_ns)
    assert (history.t_s[1:] * 1e6).round(3).tolist() == [0, 100, 150, 250, 300, 330]
    assert history.lux[1:].tolist() == [0.5, 1.0, 0.5, 1.0, 0.5, 1.5]
    edges = [(edge.time_ns - begin_ns, edge.rising) for edge in world.triggers(begin_ns, world.clock.now_ns)]
    assert edges == [(100_000, True), (150_000, False), (250_000, True), (300_000, False), (330_000, True)]


def test_the_same_line_again_is_answered_and_not_obeyed_again(firmware: LedFirmware) -> None:
    world = firmware._world
    ask(firmware, "square 10 20 100 30 2 50")
    play = encode_line("2 play 4 250")
    first = talk(firmware, play)
    now_ns = world.clock.now_ns
    assert first == encode_line("2 ok") + encode_line("2 done 4 0")
    assert talk(firmware, play) == encode_line("2 done 4 0")
    assert world.clock.now_ns == now_ns


def test_the_watchdog_makes_it_dark(firmware: LedFirmware) -> None:
    world = firmware._world
    assert ask(firmware, "watchdog 500", "level 100") == ["ok", "ok 100"]
    world.clock.sleep(0.4)
    assert ask(firmware, "level?") == ["ok 100"]
    world.clock.sleep(0.6)
    assert ask(firmware, "level?") == ["watchdog", "ok 0"]
    assert world.lux() == 0.0


def test_without_power_it_is_dark_and_knows_nothing(firmware: LedFirmware) -> None:
    sent = bytearray()
    ask(firmware, "square 10 20 100 30 2 50", "watchdog 500", "level 100")
    firmware.reboot(sent.extend)
    assert sent == b"! boot evs-led*2A6B\n"
    assert firmware._world.lux() == 0.0
    assert ask(firmware, "status", "play 4 250") == [
        "ok level=0 playing=0 stored=0 watchdog_ms=0",
        "error 6 no whole waveform",
    ]
