"""Speed of the EVT3 decoder beside that of the package `evt3`: same bytes, same run, same output.

    python benchmarks/decode.py [millions of events]

The stream is synthetic: half singles, half vectors, 2.66 bytes an event, with external triggers and
a rollover of the clock. Each figure is the best of several runs on one thread, after a warm-up.
"""

from __future__ import annotations

import platform
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import evt3
import numpy as np

from drivers.events.decoders import Evt3Decoder
from drivers.events.encode import Evt3Encoder, raw_header
from drivers.events.raw import CHUNK_BYTES, open_recording
from drivers.events.types import EVENT_DTYPE, TRIGGER_DTYPE

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

WIDTH: Final = 1280
HEIGHT: Final = 720
BLOCK: Final = 200_000  #: groups of events that are drawn; the stream repeats them, later and later
SHARE_OF_VECTORS: Final = 0.166  #: of the groups: about half of the events, and 2.66 bytes an event
GROUP_STEP_US: Final = 10  #: longest step in time from one group to the next
TRIGGER_STEP_US: Final = 100_000
REPEATS: Final = 7


def draw_block(rng: np.random.Generator) -> npt.NDArray[np.void]:
    """Draw groups of events, each of one time, row and polarity: one to three columns, or a vector of 32."""
    vector = rng.random(BLOCK) < SHARE_OF_VECTORS
    columns = np.zeros((BLOCK, 32), bool)
    columns[vector] = rng.random((int(vector.sum()), 32)) < 0.3
    counts = np.where(vector, columns.sum(axis=1), rng.integers(1, 4, BLOCK))
    group = np.repeat(np.arange(BLOCK), counts)
    events = np.empty(len(group), EVENT_DTYPE)
    events["t"] = np.cumsum(rng.integers(1, GROUP_STEP_US + 1, BLOCK))[group]
    events["y"] = rng.integers(0, HEIGHT, BLOCK)[group]
    events["p"] = rng.integers(0, 2, BLOCK)[group]
    events["x"] = rng.integers(0, WIDTH, len(group))
    owner, column = np.nonzero(columns)
    start = rng.integers(0, WIDTH // 32, BLOCK) * 32
    events["x"][vector[group]] = start[owner] + column
    return events


def make_stream(n: int) -> tuple[bytes, npt.NDArray[np.void], npt.NDArray[np.void]]:
    """Return a stream of `n` events, and the events and triggers in it."""
    block = draw_block(np.random.default_rng(1))
    length_us = int(block["t"][-1]) + 1
    parts = []
    for k in range(-(-n // len(block))):
        part = block.copy()
        part["t"] += k * length_us
        parts.append(part)
    events = np.concatenate(parts)[:n]
    triggers = np.zeros(int(events["t"][-1]) // TRIGGER_STEP_US, TRIGGER_DTYPE)
    triggers["t"] = np.arange(1, len(triggers) + 1) * TRIGGER_STEP_US
    triggers["p"] = np.arange(len(triggers)) % 2
    return Evt3Encoder(WIDTH, HEIGHT).feed(events, triggers), events, triggers


def best_s(run: Callable[[], Any]) -> float:
    """Return the shortest time of `run`, s."""
    times = []
    run()
    for _ in range(REPEATS):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return min(times)


def decode_in_chunks(stream: memoryview) -> int:
    """Decode a stream that is in memory, chunk by chunk, and return the number of events."""
    decoder = Evt3Decoder(WIDTH, HEIGHT)
    return sum(len(decoder.feed(stream[i : i + CHUNK_BYTES]).events) for i in range(0, len(stream), CHUNK_BYTES))


def same_events(ours: npt.NDArray[np.void], theirs: Any) -> bool:
    """Return whether the package's arrays hold the same events as ours."""
    pairs = (("t", theirs.timestamp), ("x", theirs.x), ("y", theirs.y), ("p", theirs.polarity))
    return len(ours) == len(theirs) and all(bool(np.array_equal(ours[name], values)) for name, values in pairs)


def check(stream: bytes, events: npt.NDArray[np.void], triggers: npt.NDArray[np.void]) -> None:
    """Print whether all outputs are equal, and stop if they are not."""
    decoder = Evt3Decoder(WIDTH, HEIGHT)
    chunk = decoder.feed(stream)
    theirs = evt3.decode_bytes(stream, WIDTH, HEIGHT)
    results = {
        "ours = events that were encoded": bool(np.array_equal(chunk.events, events)),
        "ours = triggers that were encoded": bool(np.array_equal(chunk.triggers, triggers)),
        "ours = evt3": same_events(chunk.events, theirs),
        "violations = 0": not any(decoder.violations.values()),
    }
    for what, holds in results.items():
        print(f"{what}: {'yes' if holds else 'NO'}")
    if not all(results.values()):
        sys.exit(1)


def main() -> None:
    """Print the table."""
    n = int(float(sys.argv[1]) * 1e6) if len(sys.argv) > 1 else 20_000_000
    stream, events, triggers = make_stream(n)
    view = memoryview(stream)
    print(f"{n} events, {len(triggers)} triggers, {len(stream) / n:.2f} bytes an event; {platform.processor()}")
    check(stream, events, triggers)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "stream.raw"
        path.write_bytes(raw_header(WIDTH, HEIGHT) + stream)
        runs: tuple[tuple[str, Callable[[], Any]], ...] = (
            ("ours, decode only, in chunks", lambda: decode_in_chunks(view)),
            ("ours, decode only, one array", lambda: Evt3Decoder(WIDTH, HEIGHT).feed(stream)),
            ("ours, with reading, in chunks", lambda: sum(len(c.events) for c in open_recording(path).chunks())),
            ("ours, with reading, one array", lambda: next(open_recording(path, chunk_bytes=1 << 30).chunks())),
            ("evt3, decode only, one set of arrays", lambda: evt3.decode_bytes(stream, WIDTH, HEIGHT)),
            ("evt3, with reading, in batches", lambda: sum(len(b) for b in evt3.decode_file_batches(str(path)))),
            ("evt3, with reading, one set of arrays", lambda: evt3.decode_file(str(path))),
        )
        print(f"\n{'':40}{'Mev/s':>8}{'MB/s':>8}")
        for name, run in runs:
            seconds = best_s(run)
            print(f"{name:40}{n / seconds / 1e6:8.0f}{len(stream) / seconds / 1e6:8.0f}")


if __name__ == "__main__":
    main()
