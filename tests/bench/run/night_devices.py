"""Devices that go wrong in the night, and what a test has to see of a run."""

from __future__ import annotations

import io
import json
import time
from typing import TYPE_CHECKING, Any

from bench.run.progress import LineProgress
from drivers.errors import ConnectionFailed, DataLost
from protocols import LoadedProtocol, parse_protocol
from sim_backend.devices.light import SimulatedLightSource

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bench.run.progress import Status
    from drivers.interfaces import PlayedWaveform, Waveform


class Telling(LineProgress):
    """Keeps what the operator is told, and does something when so many points are dealt with."""

    def __init__(self, at: int = -1, do: Callable[[], None] = lambda: None) -> None:
        super().__init__(io.StringIO(), 0.0)
        self._at, self._do = at, do
        self.seen: list[Status] = []

    def update(self, status: Status) -> None:
        super().update(status)
        self.seen.append(status)
        if status.done == self._at:
            self._at = -1
            self._do()

    @property
    def text(self) -> str:
        return self._stream.getvalue()  # type: ignore[attr-defined,no-any-return]


class NightLight(SimulatedLightSource):
    """A light source to which something happens when it plays for the n-th time, counted over all its lives."""

    fails_at: frozenset[int] = frozenset()
    hangs_at: frozenset[int] = frozenset()
    gone_for = 0  #: so often it does not answer when it is connected again after a failure
    other_after_failure = False
    played = 0
    lives = 0
    failed = False

    def _connect(self) -> None:
        self.lives += 1
        if self.failed and self.gone_for > 0:
            self.gone_for -= 1
            raise ConnectionFailed(self.name, "connect", "no such port", "is it plugged in?")
        super()._connect()

    def identity(self) -> dict[str, str]:
        other = self.other_after_failure and self.failed
        return super().identity() | ({"serial": "another one"} if other else {})

    def _play(self, waveform: Waveform) -> PlayedWaveform:
        self.played += 1
        if self.played in self.fails_at:
            self.failed = True
            raise DataLost(self.name, "play a waveform", "the line went dead", "check the cable")
        if self.played in self.hangs_at:
            time.sleep(60.0)
        return super()._play(waveform)


def light(**what: Any) -> type[NightLight]:
    """Return a class of light sources with other attributes."""
    return type("Light", (NightLight,), what)


def with_policy(protocol: LoadedProtocol, *lines: str) -> LoadedProtocol:
    """Return the protocol with further lines at its top level."""
    head, _, rest = protocol.text.partition("measurements:")
    return parse_protocol("".join([head, *(f"{line}\n" for line in lines), "measurements:", rest]), protocol.source)


def journal(folder: Path) -> list[dict[str, Any]]:
    """Return the lines of the journal."""
    return [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]


def states(folder: Path) -> list[tuple[str, int | None, int | None]]:
    """Return state, point and attempt of each line that is not about the plan."""
    lines = [line for line in journal(folder) if line["state"] != "planned"]
    return [(line["state"], line.get("point"), line.get("attempt")) for line in lines]
