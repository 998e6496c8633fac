"""Faults of each instrument in whole runs; `benchmarks/wire_faults.py` puts them at every request."""

from __future__ import annotations

import functools
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.wire_faults import FAULTS, Trial, Verdict, main, pattern_of, places_of, requests_of, take
from sim_backend.wire.faults import Fault

if TYPE_CHECKING:
    from pathlib import Path

_DEVICES = {"wheel": "filter wheel", "operator": "filter", "camera": "camera"}
#: Of each instrument and fault so many requests, drawn by lot.
_DRAWN = 1
KINDS = [(*head, fault) for head, faults in FAULTS.items() for fault in faults]


@functools.cache
def requests(station: str, instrument: str) -> int:
    return requests_of(station, instrument)


def require_sound(trial: Trial, verdict: Verdict) -> None:
    """Require that the light is out, no point is damaged, and a run that did not finish says why."""
    assert verdict.damaged == 0
    assert verdict.finished or verdict.told
    assert not verdict.told or _DEVICES.get(trial.instrument, "light source") in verdict.told
    # An RS-7 that was lit by somebody else stays so if it is unplugged before it was told anything.
    found_lit = (trial.instrument, trial.fault) == ("rs7", Fault.UNPLUGGED) and verdict.requests <= 2
    assert verdict.dark or found_lit


@pytest.mark.slow
@pytest.mark.parametrize(("station", "instrument", "fault"), KINDS, ids=lambda part: str(part))
def test_the_light_ends_dark_and_no_point_is_damaged(station: str, instrument: str, fault: Fault) -> None:
    lot = np.random.default_rng(KINDS.index((station, instrument, fault)))
    for at in lot.integers(0, requests(station, instrument), _DRAWN).tolist():
        trial = Trial(station, instrument, fault, at)
        require_sound(trial, take(trial))


@pytest.mark.parametrize(
    ("station", "instrument", "fault", "at"),
    [
        ("wire", "led_driver", Fault.ALARM, 8),
        ("wire_rs7", "rs7", Fault.REPLY_LOST, 30),
        ("wire_generator:siglent", "generator", Fault.UNPLUGGED, 100),
        ("wire_generator", "operator", Fault.REPLY_LOST, 1),
    ],
)
def test_a_run_with_a_fault_says_which_device(station: str, instrument: str, fault: Fault, at: int) -> None:
    trial = Trial(station, instrument, fault, at)
    verdict = take(trial)
    require_sound(trial, verdict)
    assert verdict.told


def test_places_are_all_requests_or_some_of_them() -> None:
    assert places_of(5, 0) == places_of(5, 9) == [0, 1, 2, 3, 4]
    assert places_of(100, 4) == [12, 37, 62, 87]


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("camera: write 0x0A to 0xB004: came 8 bytes: 02 01", "camera: write 0x1 to 0xB1: came 4 bytes: 0f a0 07"),
        ("light source: POT: only b'\\x01\\'x' within 0.2 s", 'light source: POT: only b"_\'x" within 0.19 s'),
        ("OUT 4.5e+3: nothing within 2 s", "OUT 17: nothing within 0.2 s"),
    ],
)  # fmt: skip
def test_messages_that_differ_in_numbers_and_bytes_alone_are_one(one: str, other: str) -> None:
    assert pattern_of(one) == pattern_of(other)
    assert pattern_of(one) != pattern_of(one.replace(":", ";", 1))


def test_what_is_known_is_not_taken_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["--only", "operator", "--places", "0", "--workers", "1", "--results", str(tmp_path / "r.jsonl")]
    asked += ["--docs", str(tmp_path / "table.md")]
    assert main(asked) == 0
    assert re.search(r"1 runs are known, 2 to take", capsys.readouterr().out)
    with (tmp_path / "r.jsonl").open("a") as file:
        file.write('{"trial": "cut off')
    assert main(asked) == 0
    assert re.search(r"3 runs are known, 0 to take", capsys.readouterr().out)
    table = (tmp_path / "table.md").read_text()
    assert "| wire_generator | operator | reply_lost | 2 | 2 | 0 | 0 | 2 | 2 | 1 | 0 |" in table
    assert "the terminal was closed before it was confirmed" in table
