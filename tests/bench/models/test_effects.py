"""The descriptions of the effects, and the table in the docs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bench.models.effects import EffectDescription, describe, described_effects
from protocols.errors import InputError
from sim_backend.pixel.effects import STAGES, effects

TABLE = Path(__file__).resolve().parents[3] / "docs" / "reference" / "effects.md"


def row(effect: EffectDescription) -> str:
    """Return the row of the table that an effect should have."""
    null = {p.name: "-" if p.null is None else f"{p.null:g}" for p in effect.parameters}
    parameters = ", ".join(f"`{p.name}` ({p.unit}; null {null[p.name]})" for p in effect.parameters)
    return f"| `{effect.id}` | {effect.stage} | {parameters} | {effect.summary.replace('``', '`')} | {effect.sign} |"


def test_the_table_in_the_docs_is_that_of_the_program() -> None:
    written = [line for line in TABLE.read_text().splitlines() if line.startswith("| `")]
    assert written == [row(effect) for effect in described_effects()]


def test_each_effect_has_a_figure_in_the_docs() -> None:
    shown = re.findall(r"!\[(\w+)\]\(effects/(\w+)\.png\)", TABLE.read_text())
    assert [name for name, _ in shown] == [file for _, file in shown] == [e.id for e in described_effects()]
    drawn = {path.stem for path in (TABLE.parent / "effects").glob("*.png")}
    assert drawn == set(effects())


def test_effects_are_listed_in_the_order_of_the_signal() -> None:
    listed = described_effects()
    assert {e.id for e in listed} == set(effects())
    stages = [STAGES.index(e.stage) for e in listed]
    assert stages == sorted(stages)


def test_an_effect_is_described_in_full() -> None:
    leak = describe("leak")
    assert leak.stage == "change detector"
    assert leak.summary == "The memorised level sinks: ``D = V - V_ref + rate (t - t_reset)``."
    assert "Nozaki" in leak.text
    assert [p.name for p in leak.parameters] == ["rate_per_s", "spread"]
    with pytest.raises(InputError, match="did you mean shot_noise"):
        describe("shotnoise")
