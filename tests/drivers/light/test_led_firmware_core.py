"""The protocol core of the sketch, compiled for this computer, answers byte for byte as the emulated device does."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from drivers.light.led_protocol import crc16, encode_line
from sim_backend.wire.led_driver import LedFirmware
from sim_backend.world import OpticalBench

COMPILER = shutil.which("g++") or shutil.which("c++") or shutil.which("clang++")
SKETCH = Path(__file__).parents[3] / "drivers" / "firmware" / "led_driver"
WARNINGS = ["-Wall", "-Wextra", "-Wconversion", "-Wsign-conversion", "-pedantic", "-Werror"]
MAX_EDGES = 64


@pytest.fixture(name="host", scope="module")
def compiled_core(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if COMPILER is None:
        pytest.skip("there is no C++ compiler")
    program = tmp_path_factory.mktemp("led") / "host"
    source = Path(__file__).parent / "led_host.cpp"
    options = ["-std=c++11", *WARNINGS, "-fsanitize=undefined", "-fno-sanitize-recover", f"-I{SKETCH}"]
    defines = [f"-DEVS_LED_MAX_EDGES={MAX_EDGES}"]
    command = [COMPILER, *options, *defines, str(source), "-o", str(program)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return program


def core_answers(host: Path, lines: list[bytes]) -> bytes:
    done = subprocess.run([str(host)], input=b"".join(lines), capture_output=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


class Recorder(OpticalBench):
    """A world that notes what becomes of its light."""

    def __init__(self) -> None:
        self.log: list[bytes] | None = None
        self.begin_ns = 0
        super().__init__(lux_per_level=0.05, pixel={"noise_rms": 0.03, "theta_off": 0.25}, sensor_seed=5)

    def set_level(self, level: float) -> None:
        super().set_level(level)
        if self.log is not None:
            self.log.append(b"@ %d %d\n" % ((self.clock.now_ns - self.begin_ns) // 1000, level))


def emulated_answers(firmware: LedFirmware, bench: Recorder, line: bytes) -> bytes:
    """Return what the emulated device answers, with the light of a waveform that it plays."""
    sent: list[bytes] = []
    bench.begin_ns = bench.clock.now_ns
    bench.log = [] if b" play " in line else None
    firmware.obey(line.removesuffix(b"\n"), sent.append)
    played, bench.log = bench.log or [], None
    return b"".join(sent[:1] + played + sent[1:])


def emulated() -> tuple[LedFirmware, Recorder]:
    bench = Recorder()
    return LedFirmware(bench, max_edges=MAX_EDGES), bench


def test_documented_lines(host: Path) -> None:
    assert core_answers(host, [b"1 hello*E648\n"]) == encode_line(
        "1 ok evs-led protocol=1 firmware=1.0 serial=emulated tick_us=1 dac_bits=16 max_edges=64 shortest_us=20"
    )
    garbled = encode_line("? error 1 garbled")
    assert core_answers(host, [b"1 hello*E649\n", b"\n", b"1 hello\n"]) == 3 * garbled


NUMBERS = np.array([0, 1, 2, 3, 4, 5, 7, 19, 20, 21, 100, 1000, 65535, 65536, 2_000_000_000, 4_294_967_295, 1 << 32])
COUNTS = {"hello": 0, "level": 1, "level?": 0, "dark": 0, "abort": 0, "status": 0, "watchdog": 1, "wave": 6}
COMMANDS = [*COUNTS, "edges", "square", "play", "nonsense", ""]


def random_command(rng: np.random.Generator) -> str:
    """Return a command that often makes sense, and sometimes does not."""
    name = str(rng.choice(COMMANDS))
    numbers = [int(n) for n in rng.choice(NUMBERS, COUNTS.get(name, 2))]
    if name == "watchdog":
        numbers = [0]
    if name == "wave" and rng.random() < 0.9:
        edges = int(rng.integers(0, 9))
        loop_from = int(rng.integers(0, edges + 1))
        loop_edges = int(rng.integers(0, edges - loop_from + 1))
        numbers = [int(rng.integers(0, 9)), edges, loop_from, loop_edges, int(rng.integers(0, 5)), 30]
    if name == "square":
        numbers = [*(int(n) for n in rng.integers(0, 100, 4)), int(rng.integers(0, 9)), int(rng.integers(0, 100))]
    if name == "edges":
        pairs = [f"{rng.choice(NUMBERS)}:{rng.choice(NUMBERS)}" for _ in range(rng.integers(0, 4))]
        return " ".join([name, str(rng.integers(0, 4)), *pairs])
    if rng.random() < 0.05:
        numbers.append(1)
    return " ".join([name, *(str(n) for n in numbers), *([""] if rng.random() < 0.02 else [])])


def fitting(firmware: LedFirmware, rng: np.random.Generator) -> str:
    """Return the command that goes on with what is stored: its next edges, or to play it."""
    wave = firmware._wave
    if wave is None:
        return "status"
    missing = wave.announced - len(wave.edges)
    if missing:
        pairs = [f"{20 + rng.integers(0, 50)}:{rng.integers(0, 999)}" for _ in range(rng.integers(1, missing + 1))]
        return " ".join(["edges", str(len(wave.edges)), *pairs])
    edges, duration_us = wave.totals()
    return f"play {edges} {duration_us}" if edges < 1000 else "status"


@pytest.mark.parametrize("seed", range(3))
def test_random_lines_are_answered_alike(host: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    firmware, bench = emulated()
    lines: list[bytes] = []
    answers: list[bytes] = []
    for number in range(3000):
        text = fitting(firmware, rng) if rng.random() < 0.4 else random_command(rng)
        line = encode_line(f"{number if rng.random() < 0.98 else 'x1'} {text}")
        choice = rng.random()
        if choice < 0.05 and lines:
            line = lines[-1]
        elif choice < 0.1:
            at = int(rng.integers(0, len(line) - 1))
            garbled = int(rng.integers(11, 256))  # no LF
            line = line[:at] + bytes([garbled]) + line[at + 1 :]
        lines.append(line)
        answers.append(emulated_answers(firmware, bench, line))
    assert sum(b"done" in answer for answer in answers) > 100
    assert sum(b"error" in answer for answer in answers) > 500
    assert core_answers(host, lines) == b"".join(answers)


def test_random_bytes_are_answered_alike(host: Path) -> None:
    rng = np.random.default_rng(9)
    firmware, bench = emulated()
    lines = []
    for _ in range(2000):
        data = rng.integers(0, 256, rng.integers(0, 300), np.uint8).tobytes().replace(b"\n", b"")
        lines.append(data + (b"*%04X" % crc16(data) if rng.random() < 0.5 else b"") + b"\n")
    assert core_answers(host, lines) == b"".join(emulated_answers(firmware, bench, line) for line in lines)


def while_it_plays(host: Path, *texts: str) -> list[str]:
    """Return what the core says when lines come between the edges of a square wave, without checksums."""
    lines = [encode_line(f"{number} {text}") for number, text in enumerate(("square 10 20 60 30 2 30", *texts))]
    done = subprocess.run([str(host), "slow"], input=b"".join(lines), capture_output=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return [line.partition("*")[0] for line in done.stdout.decode().splitlines()]


def test_what_would_disturb_a_waveform_is_refused_while_it_is_played(host: Path) -> None:
    assert while_it_plays(host, "play 4 150", "level 5", "level?", "wave 1 1 0 0 1 0", "status", "level 5") == [
        *("0 ok 4", "1 ok", "@ 0 10"),
        *("@ 30 20", "2 error 8 playing"),
        *("@ 60 10", "3 ok 10"),
        *("@ 90 20", "4 error 8 playing"),
        *("@ 120 10", "5 ok level=10 playing=1 stored=4 watchdog_ms=0"),
        *("1 done 4 0", "6 ok 5"),
    ]


@pytest.mark.parametrize(("text", "level"), [("dark", 0), ("abort", 20)])
def test_a_waveform_can_be_ended(host: Path, text: str, level: int) -> None:
    assert while_it_plays(host, "play 4 150", text, "level?", "play 4 150")[3:] == [
        *("@ 30 20", f"2 ok {level}", f"3 ok {level}", "4 ok", "@ 0 10"),
    ]


def test_the_sketch_and_its_document_know_the_same_errors() -> None:
    document, source = (SKETCH / "README.md").read_text(), (SKETCH / "protocol.h").read_text()
    texts = re.findall(r'"([^"]*)"', source.partition("kTexts[] = {")[2].partition("}")[0])
    assert texts[0] == ""
    assert re.findall(r"^\| (\d) \| (.*) \|$", document.partition("| code | text |")[2], re.MULTILINE) == [
        (str(code), text) for code, text in enumerate(texts) if code
    ]
