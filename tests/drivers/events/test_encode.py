"""The encoder: what it writes is read back as it was, by our decoder and by the package `evt3`."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import evt3
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.events.decoders import Evt3Decoder
from drivers.events.encode import Evt3Encoder
from drivers.events.types import EVENT_DTYPE, TRIGGER_DTYPE, empty_events

if TYPE_CHECKING:
    import numpy.typing as npt

WIDTH, HEIGHT = 1270, 720  # the last block of 32 columns is not whole


def draw(seed: int, n: int, longest_step_us: int) -> tuple[npt.NDArray[np.void], npt.NDArray[np.void]]:
    """Draw events, many of them side by side in one row at one time, and triggers."""
    rng = np.random.default_rng(seed)
    events = np.zeros(n, EVENT_DTYPE)
    new_group = rng.random(n) < 0.1
    group = np.cumsum(new_group)
    events["t"] = np.cumsum(rng.integers(0, longest_step_us, n) * new_group)
    events["y"] = rng.integers(0, HEIGHT, group[-1] + 1 if n else 1)[group]
    events["p"] = rng.integers(0, 2, group[-1] + 1 if n else 1)[group]
    events["x"] = (np.cumsum(rng.integers(1, 4, n)) + 1000 * group) % WIDTH
    triggers = np.zeros(n // 10, TRIGGER_DTYPE)
    triggers["t"] = np.sort(rng.integers(0, (events["t"][-1] if n else 0) + 10, n // 10))
    triggers["p"] = rng.integers(0, 2, n // 10)
    triggers["id"] = rng.integers(0, 16, n // 10)
    return events, triggers


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 500), st.sampled_from([3, 5000, 3_000_000]), st.integers(0, 500))
def test_round_trip_in_two_pieces(seed: int, n: int, longest_step_us: int, cut: int) -> None:
    events, triggers = draw(seed, n, longest_step_us)
    cut_t = events["t"][cut] if cut < n else np.iinfo(np.int64).max
    encoder = Evt3Encoder(WIDTH, HEIGHT)
    data = encoder.feed(events[events["t"] < cut_t], triggers[triggers["t"] < cut_t])
    data += encoder.feed(events[events["t"] >= cut_t], triggers[triggers["t"] >= cut_t])
    decoder = Evt3Decoder(WIDTH, HEIGHT)
    chunk = decoder.feed(data)
    decoder.finish()
    np.testing.assert_array_equal(chunk.events, events)
    np.testing.assert_array_equal(chunk.triggers, triggers)
    assert not any(decoder.violations.values())
    theirs = evt3.decode_bytes(data, WIDTH, HEIGHT)
    np.testing.assert_array_equal(theirs.timestamp, events["t"])
    np.testing.assert_array_equal(theirs.x, events["x"])


def test_words_of_a_vector() -> None:
    events = np.zeros(5, EVENT_DTYPE)
    events["t"], events["x"], events["y"], events["p"] = 3, [32, 43, 44, 56, 63], 9, 1
    words = [0x8000, 0x6003, 0x0009, 0x3820, 0x4801, 0x4001, 0x5081]
    assert Evt3Encoder(WIDTH, HEIGHT).feed(events) == struct.pack("<7H", *words)


def test_what_cannot_be_encoded_is_refused() -> None:
    event = np.zeros(1, EVENT_DTYPE)
    encoder = Evt3Encoder(640, 480)
    event["t"] = 10
    encoder.feed(event)
    event["t"] = 9
    with pytest.raises(ValueError, match="back in time"):
        encoder.feed(event)
    event["t"], event["x"] = 10, 640
    with pytest.raises(ValueError, match="outside of 640 x 480"):
        encoder.feed(event)
    with pytest.raises(ValueError, match="channel over 15"):
        encoder.feed(empty_events(), np.array([(10, 0, 16)], TRIGGER_DTYPE))
    with pytest.raises(ValueError, match="1 to 2048"):
        Evt3Encoder(2049, 480)
