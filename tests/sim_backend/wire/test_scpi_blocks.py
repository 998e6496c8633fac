"""Samples among the lines to an emulated generator: found however the bytes are cut, refused where they are wrong."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_backend.wire.scpi_makers import emulated_generator
from sim_backend.wire.scpi_samples import Refused, block_of, requests_of, shares_of
from sim_backend.world import OpticalBench

HEADS = {
    "rigol": b":SOUR1:TRAC:DATA:DAC16 VOLATILE,END,#%d%d",
    "keysight": b"DATA:ARB:DAC EVSBENCH,#%d%d",
    "siglent": b"C1:WVDT WVNM,EVSBENCH,TYPE,5,LENGTH,%dB,FREQ,1.0,AMPL,1.0,OFST,0.0,PHASE,0.0,WAVEDATA,",
}


def line_of(dialect: str, data: bytes) -> bytes:
    if dialect == "siglent":
        return HEADS[dialect] % len(data) + data
    return HEADS[dialect] % (len(str(len(data))), len(data)) + data


@settings(max_examples=150, deadline=None)
@given(
    dialect=st.sampled_from(sorted(HEADS)),
    data=st.binary(min_size=1, max_size=300),
    cuts=st.lists(st.integers(1, 40), max_size=60),
)
def test_lines_are_the_same_however_the_bytes_come(dialect: str, data: bytes, cuts: list[int]) -> None:
    wanted = [b"*IDN?", line_of(dialect, data), b"SYST:ERR?"]
    stream, buffer, found = b"\n".join(wanted) + b"\n", bytearray(), []
    for size in [*cuts, len(stream)]:
        buffer += stream[:size]
        stream = stream[size:]
        found += requests_of(buffer)
    assert found == wanted
    assert not buffer


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=400))
def test_any_bytes_end_as_lines_or_wait(data: bytes) -> None:
    buffer = bytearray(data)
    for request in requests_of(buffer):
        try:
            block_of(request)
        except Refused:
            continue


@settings(max_examples=100, deadline=None)
@given(dialect=st.sampled_from(sorted(HEADS)), tail=st.binary(max_size=200))
def test_a_block_that_was_cut_is_refused_and_not_played(dialect: str, tail: bytes) -> None:
    world = OpticalBench(lux_per_level=0.05, pixel={"noise_rms": 0.03, "theta_off": 0.25}, sensor_seed=5)
    firmware = emulated_generator(world, dialect)
    firmware.obey(line_of(dialect, bytes(400))[: -(1 + len(tail))], lambda _: None)
    assert not firmware.settings.memory
    answers: list[bytes] = []
    firmware.obey(b"SYST:ERR?", answers.append)
    assert answers[0].startswith(b'-161,"Invalid block data"')


@pytest.mark.parametrize(("count", "lowest"), [(14, 0), (7, 0), (15, 0), (16, 5)])
def test_too_few_samples_and_codes_out_of_range_are_refused(count: int, lowest: int) -> None:
    with pytest.raises(Refused):
        shares_of(bytes(count), "<u2", lowest, 16_383, 8, 16)


def test_codes_are_parts_of_the_way_between_the_levels() -> None:
    data = np.array([-32_767, 0, 32_767, 0, 0, 0, 0, 0], ">i2").tobytes()
    assert shares_of(data, ">i2", -32_767, 32_767, 8, 16)[:3].tolist() == [0.0, 0.5, 1.0]


def test_by_frequency_a_rigol_stretches_the_samples() -> None:
    world = OpticalBench(lux_per_level=0.05, pixel={"noise_rms": 0.03, "theta_off": 0.25}, sensor_seed=5)
    firmware = emulated_generator(world, "rigol")
    firmware.obey(line_of("rigol", bytes(40)), lambda _: None)
    assert len(firmware.settings.memory["VOLATILE"]) == 8192
    firmware.obey(b":SOUR1:FUNC:ARB:MODE SRATE", lambda _: None)
    firmware.obey(line_of("rigol", bytes(40)), lambda _: None)
    answers: list[bytes] = []
    firmware.obey(b":SOUR1:DATA:POIN? VOLATILE", answers.append)
    assert answers == [b"20\n"]
    assert firmware.settings.function == "USER"


def test_a_keysight_takes_no_second_waveform_of_a_name_and_knows_the_order_of_bytes() -> None:
    world = OpticalBench(lux_per_level=0.05, pixel={"noise_rms": 0.03, "theta_off": 0.25}, sensor_seed=5)
    firmware = emulated_generator(world, "keysight")
    answers: list[bytes] = []
    firmware.obey(b"FORM:BORD SWAP", answers.append)
    firmware.obey(line_of("keysight", np.arange(0, 800, 100).astype("<i2").tobytes()), answers.append)
    assert firmware.settings.memory["EVSBENCH"][-1] == pytest.approx((700 + 32_767) / 65_534)
    firmware.obey(line_of("keysight", bytes(40)), answers.append)
    firmware.obey(b"SYST:ERR?", answers.append)
    assert answers[0].startswith(b"-161")
