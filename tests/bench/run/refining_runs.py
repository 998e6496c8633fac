"""A run whose curves are refined, and what a test has to see of it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.store import Run
from drivers.events.types import EVENT_DTYPE
from protocols import LoadedProtocol, parse_protocol

if TYPE_CHECKING:
    from pathlib import Path

REFINE = "refine: {until: {gap: 0.02}, at_most: 4}"
TEXT = """\
format: evs-bench-protocol/1
title: a curve that is refined
seed: 8
roi: {x: 10, y: 20, width: 4, height: 3}
expect: {dark_light_lux: 0.146}
settings: {thresholds: {on: 0.3, off: 0.25}, refractory_period_s: 0.01, bandwidth_hz: 200}
pulses: 4
measurements:
  - name: "on"
    stimulus: {kind: reset_test, polarity: "on", gap_s: 0.03, reset_s: 0.03, test_s: 0.03,
               reset_contrast: {scale: log, value: 0.8}}
    sweep:
      illuminance_lux: [100]
      contrast:
        scale: threshold
        linspace: {start: 0.1, stop: 1.5, num: 4}
        REFINE
  - name: "dark"
    stimulus: {kind: constant, duration_s: 0.2}
    sweep: {illuminance_lux: [100]}
"""


def protocol(refine: str = REFINE, *replaced: tuple[str, str]) -> LoadedProtocol:
    """Return the protocol with another key, or with other pieces of text."""
    text = TEXT.replace("REFINE", refine)
    for old, new in replaced:
        assert old in text
        text = text.replace(old, new)
    return parse_protocol(text, "refined.yaml")


def lines(folder: Path) -> list[dict[str, Any]]:
    """Return the lines of the journal."""
    return [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]


def decisions(folder: Path) -> list[dict[str, Any]]:
    """Return the lines that changed the plan, without their time."""
    return [{k: v for k, v in line.items() if k != "t"} for line in lines(folder) if line["state"] == "plan_changed"]


def contents(folder: Path) -> dict[int, tuple[float, int, Any]]:
    """Return contrast, seed and events of each point."""
    return {
        point.index: (
            point.log_contrast,
            int(point.attributes["seed"]),
            np.concatenate([np.empty(0, EVENT_DTYPE), *point.events()]),
        )
        for point in Run.open(folder).points()
    }


def assert_same(folder: Path, whole: Path) -> None:
    """Require that two runs have the same decisions, and points with the same events."""
    Run.open(folder).verify()
    mine, theirs = contents(folder), contents(whole)
    assert mine.keys() == theirs.keys()
    for index, (contrast, seed, events) in theirs.items():
        assert mine[index][:2] == (contrast, seed)
        np.testing.assert_array_equal(mine[index][2], events)
    assert decisions(folder) == decisions(whole)
    assert lines(folder)[-1]["state"] == "run_finished"
