"""Waveforms as samples: what comes out of the memory is what was asked for, or the reason why it cannot be."""

from __future__ import annotations

import re
import time
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import DeviceError, UnexpectedAnswer
from drivers.interfaces import Waveform
from drivers.light.scpi_dialects import DIALECTS
from drivers.light.scpi_samples import Memory, Samples, codes_of, samples_of
from drivers.light.scpi_uploads import upload_for
from drivers.light.waveform_shapes import NoShape
from drivers.transport.trace import Trace
from sim_backend.wire.faults import Fault, FaultPlan, Faults
from tests.drivers.light.scpi_support import (
    DIALECT_NAMES,
    ScpiBench,
    pulses,
    scpi_bench,
    square,
    with_unequal_gaps,
)

if TYPE_CHECKING:
    from pathlib import Path

MEMORY = Memory(fewest=8, most=16_384, codes=1 << 14, highest_hz=60e6)


def sampled(waveform: Waveform, memory: Memory = MEMORY) -> Samples:
    samples = samples_of(waveform, memory)
    assert isinstance(samples, Samples), samples.reason
    return samples


def played(samples: Samples, first_s: float) -> tuple[list[float], list[float]]:
    """Return when a burst steps and where to, from the samples alone; its first edge is at `first_s`."""
    step_s = samples.period_s / len(samples.level)
    level = np.tile(samples.level, samples.cycles)
    at = np.flatnonzero(np.diff(level)) + 1
    return (at * step_s + first_s - samples.lead_s).tolist(), level[at].tolist()


@settings(max_examples=60, deadline=None)
@given(
    cycles=st.integers(1, 40),
    gap_us=st.integers(20, 2000).map(lambda n: 100 * n),
    test_us=st.integers(1, 1000).map(lambda n: 100 * n),
    levels=st.tuples(*[st.floats(0.5, 8.0)] * 3),
)
def test_pairs_come_out_as_they_were_asked_for(
    cycles: int, gap_us: int, test_us: int, levels: tuple[float, float, float]
) -> None:
    waveform = pulses(cycles, *levels, gap_s=gap_us * 1e-6, test_s=test_us * 1e-6)
    samples = samples_of(waveform, MEMORY)
    edge = np.flatnonzero(np.diff(waveform.level)) + 1
    if isinstance(samples, NoShape):
        assert not len(edge)
        return
    t_s, level = played(samples, float(waveform.t_s[edge[0]]))
    np.testing.assert_allclose(t_s, waveform.t_s[edge], atol=0.5e-6)
    np.testing.assert_allclose(samples.t_s[1:], waveform.t_s[edge], atol=0.5e-6)
    assert level == waveform.level[edge].tolist()
    assert samples.level[0] == samples.level[-1] == waveform.level[0]
    assert 8 <= len(samples.level) <= 16_384
    assert samples.lead_s <= waveform.t_s[edge[0]]


@pytest.mark.parametrize(
    ("waveform", "cycles"),
    [
        (pulses(30), 30),
        (square(100, 1.0 / 30.0, 0.05), 100),
        (with_unequal_gaps(square(100)), 1),
        (with_unequal_gaps(pulses(5)), 1),
    ],
)
def test_what_repeats_is_stored_once(waveform: Waveform, cycles: int) -> None:
    samples = sampled(waveform, Memory(8, 131_072, 1 << 14, 60e6))
    assert samples.cycles == cycles
    assert samples.rate_hz >= 1000.0


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.floats(1e-7, 1.0), st.sampled_from([1.0, 2.0, 5.0])), min_size=1, max_size=12),
    st.floats(0.0, 1.0),
)
def test_any_waveform_is_played_rightly_or_refused(steps: list[tuple[float, float]], rest_s: float) -> None:
    t_s = np.concatenate([[0.0], np.cumsum([after_s for after_s, _ in steps])])
    level = np.array([1.0, *(level for _, level in steps)])
    waveform = Waveform(t_s, level, float(t_s[-1]) + rest_s)
    samples = samples_of(waveform, MEMORY)
    if isinstance(samples, NoShape):
        assert re.search(r"no edge|ends at|raster|apart|first edge", samples.reason)
        return
    edge = np.flatnonzero(np.diff(level)) + 1
    found_s, found = played(samples, float(t_s[edge[0]]))
    np.testing.assert_allclose(found_s, t_s[edge], atol=0.51e-6)
    assert found == level[edge].tolist()


def test_edges_on_no_raster_are_refused_with_the_tolerance() -> None:
    t_s = np.array([0.0, 0.1, *(0.1 + np.random.default_rng(3).uniform(0.01, 0.02, 9).cumsum())])
    reason = samples_of(Waveform(t_s, np.array([1.0, *[2.0, 1.0] * 5]), 0.5), MEMORY)
    assert isinstance(reason, NoShape)
    assert re.search(r"lie on no common raster to 0\.5 us that has 16384 samples or fewer in 0\.\d+ s", reason.reason)


def test_a_step_that_is_too_fine_for_the_converter_is_refused() -> None:
    reason = codes_of(sampled(pulses(2, base=1.0, reset=8.0, test=1.002)), MEMORY)
    assert isinstance(reason, NoShape)
    assert reason.reason == "its step of 0.002 would be 0.002136: between 1 and 8 there are 16384 levels"
    assert not isinstance(codes_of(sampled(pulses(2, base=1.0, reset=8.0, test=1.2)), MEMORY), NoShape)


SENT = {
    "rigol": [
        ":SOUR1:FUNC:ARB:MODE SRATE",
        ":SOUR1:TRAC:DATA:DAC16 VOLATILE,END,#532760",
        ":SOUR1:BURS:IDLE FPT",
        ":SOUR1:FUNC:ARB:SRAT 109200",
        ":SOUR1:BURS:NCYC 3",
        ":SOUR1:VOLT:LOW 2",
        ":SOUR1:VOLT:HIGH 4",
        ":SOUR1:BURS:TRIG",
    ],
    "siglent": [
        "C1:WVDT WVNM,EVSBENCH,TYPE,5,LENGTH,32730B,FREQ,1000.0,AMPL,1.0,OFST,0.0,PHASE,0.0,WAVEDATA,",
        "C1:ARWV NAME,EVSBENCH",
        "C1:BSWV WVTP,ARB",
        "C1:SRATE MODE,TARB",
        "C1:SRATE VALUE,109100",
        "C1:SRATE INTER,HOLD",
        "C1:BTWV TIME,3",
        "C1:BTWV STPS,0",
        "C1:BSWV LLEV,2",
        "C1:BSWV HLEV,4",
        "C1:BTWV MTRIG",
    ],
    "keysight": [
        "DATA:VOL:CLE",
        "DATA:ARB:DAC EVSBENCH,#532760",
        "FUNC:ARB EVSBENCH",
        "FUNC:ARB:FILT OFF",
        "FUNC ARB",
        "FUNC:ARB:SRAT 109200",
        "BURS:NCYC 3",
        "BURS:PHAS 0",
        "VOLT:LOW 2",
        "VOLT:HIGH 4",
        "*TRG",
    ],
}


@pytest.mark.parametrize("dialect", DIALECT_NAMES)
def test_an_upload_is_that_of_the_manual(dialect: str, tmp_path: Path) -> None:
    bench = scpi_bench(dialect)
    bench.light.connect()
    bench.light.set_level(2.0)
    trace = Trace(tmp_path / "trace.txt", bench.clock)
    bench.light.trace_to(trace)
    bench.light.play(pulses())
    bench.light.trace_to(None)
    trace.close()
    lines = re.findall(r" > b['\"](.*?)(?:\\n|\\x|\.\.\.)", (tmp_path / "trace.txt").read_text())
    commands = [re.sub(r"(\d)\.?0{6,}\d$", r"\1", line) for line in lines if not line.split(" ")[0].endswith("?")]
    way_there = ("HIGH 8", "HLEV,8", "2.01")  # of the upper level, before the samples are sent
    commands = [command for command in commands if command and not any(text in command for text in way_there)]
    assert commands[-len(SENT[dialect]) :] == SENT[dialect]


@pytest.mark.parametrize("dialect", DIALECT_NAMES)
def test_blocks_hold_what_the_maker_takes(dialect: str) -> None:
    upload = upload_for(DIALECTS[dialect](1))
    code = np.arange(16_390) % upload.memory.codes
    blocks = [data for _, data in upload.blocks(code) if b"DATA" in data and b"CLE" not in data]
    assert len(blocks) == (2 if dialect == "rigol" else 1)
    assert all(len(data) >= 16 for data in blocks)
    if dialect == "rigol":
        assert b"VOLATILE,CON,#5" in blocks[0]
        assert b"VOLATILE,END,#5" in blocks[1]
    if dialect == "keysight":
        assert blocks[0].endswith(np.array(code - 32_767, ">i2").tobytes())


def test_many_samples_reach_a_rigol_in_several_blocks() -> None:
    bench = scpi_bench("rigol")
    bench.light.connect()
    waveform = with_unequal_gaps(square(cycles=1000, period_s=0.0031))
    bench.light.play(waveform)
    assert 16_384 < len(bench.firmware.settings.memory["VOLATILE"]) <= 131_072


@pytest.mark.parametrize("dialect", DIALECT_NAMES)
def test_samples_that_did_not_all_come_are_told(dialect: str) -> None:
    bench = scpi_bench(dialect)
    bench.light.connect()
    taken = type(bench.firmware)._take_in

    def lose_some(head: str, data: bytes) -> None:
        taken(bench.firmware, head, data[:-20])

    bench.firmware._take_in = lose_some  # type: ignore[method-assign]
    with pytest.raises(
        UnexpectedAnswer, match=r"number of samples.*it is|WVDT\? USER,EVSBENCH: .*bytes were expected|others"
    ):
        bench.light.play(pulses())
    bench.light.safe_state()
    assert bench.is_dark()


def requests_of_a_play(dialect: str) -> tuple[int, int]:
    """Return how many requests came before samples are played, and how many are part of it."""
    bench = scpi_bench(dialect)
    bench.light.connect()
    bench.light.set_level(2.0)
    first = bench.wire.faults.requests
    bench.light.play(pulses(2))
    count = bench.wire.faults.requests - first
    bench.light.close()
    return first, count


def play_with(dialect: str, fault: Fault, at: int) -> tuple[str, ScpiBench]:
    faults = Faults([FaultPlan(fault, at, seconds=0.15 if fault is Fault.REPLY_LATE else 0.05)])
    bench = scpi_bench(dialect, faults=faults, timeout_s=30.0)
    bench.light.connect()
    bench.light.set_level(2.0)
    bench.light._talk._link.timeout_s = 0.1  # of a busy machine not before: there is no fault yet
    said = ""
    try:
        bench.light.play(pulses(2))
    except DeviceError as error:
        said = str(error)
    return said, bench


@pytest.mark.parametrize("every", [9, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("dialect", DIALECT_NAMES)
def test_a_fault_at_any_request_of_an_upload_is_told_and_the_light_goes_out(dialect: str, every: int) -> None:
    first, count = requests_of_a_play(dialect)
    kinds = (Fault.REBOOT, Fault.REPLY_CUT, Fault.UNPLUGGED, Fault.GARBAGE, Fault.REPLY_LOST, Fault.REPLY_LATE)
    outcomes: list[str] = []
    for number in range(DIALECT_NAMES.index(dialect), count, every):
        said, bench = play_with(dialect, kinds[len(outcomes) % len(kinds)], first + number)
        assert said.startswith("light source: ") or edges_seen(bench) == 1 + 8
        bench.light._talk._link.timeout_s = 30.0
        until_s = time.monotonic() + 60.0
        bench.light.safe_state()
        while bench.light.unsafe is not None and time.monotonic() < until_s:  # the cable is not in yet
            time.sleep(0.02)
            bench.light.safe_state()
        assert bench.is_dark()
        outcomes.append(said)
        bench.light.close()
        bench.wire.close()
    assert any(outcomes)


def edges_seen(bench: ScpiBench) -> int:
    """Return how often the light changed since it was lit, what lasts no time left out."""
    history = bench.world.light(0)
    lasts = np.append(np.diff(history.t_s) > 0.0, True)
    return int(np.count_nonzero(np.diff(history.lux[lasts], prepend=0.0)))
