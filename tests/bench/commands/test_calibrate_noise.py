"""The command that looks for the noise knows a user's own effects."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from click.testing import CliRunner

from bench.commands.calibrate_noise import command
from sim_backend.pixel.effects.registry import forget_effect_files

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

OWN = """from dataclasses import dataclass

from sim_backend.pixel.effects import Effect
from sim_backend.pixel.parameters import parameter


@dataclass(frozen=True, slots=True)
class Dimmer(Effect):
    id = "dimmer"
    stage = "light"
    sign = "everything is as under less light"

    share: float = parameter("1", (0.0, 1.0), 0.5, 0.0, "light that is lost")

    def light(self, lux, t_s):
        return lux * (1.0 - self.share)
"""


def test_a_model_with_an_effect_of_ones_own_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "model.yaml").write_text("format: evs-bench-model/1\neffects: {dimmer: {share: 0.2}}\n")
    asked: list[Any] = []

    def calibrate_noise(model: Any, *_: Any, **__: Any) -> Any:
        asked.append(model)
        return SimpleNamespace(to_dict=lambda: {"rms": 0.04})

    monkeypatch.setattr("bench.models.noise_calibration.calibrate_noise", calibrate_noise)
    arguments = ["--target-hz", "0.1", "--lux", "1", "--json", "--model", str(tmp_path / "model.yaml")]
    refused = CliRunner().invoke(command, arguments)
    assert "--effects" in str(refused.exception)
    try:
        done = CliRunner().invoke(command, [*arguments, "--effects", str(tmp_path / "own.py")])
    finally:
        forget_effect_files()
    assert done.exit_code == 0, done.exception
    assert asked[0].effect("dimmer").share == 0.2
