"""The command that looks for the noise knows a user's own effects."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from click.testing import CliRunner

from bench.commands.calibrate_noise import command

if TYPE_CHECKING:
    from pathlib import Path

    import pytest


def test_a_model_with_an_effect_of_ones_own_is_taken(
    dimmer_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "model.yaml").write_text("format: evs-bench-model/1\neffects: {dimmer: {share: 0.2}}\n")
    asked: list[Any] = []

    def calibrate_noise(model: Any, *_: Any, **__: Any) -> Any:
        asked.append(model)
        return SimpleNamespace(to_dict=lambda: {"rms": 0.04})

    monkeypatch.setattr("bench.models.noise_calibration.calibrate_noise", calibrate_noise)
    arguments = ["--target-hz", "0.1", "--lux", "1", "--json", "--model", str(tmp_path / "model.yaml")]
    refused = CliRunner().invoke(command, arguments)
    assert "--effects" in str(refused.exception)
    done = CliRunner().invoke(command, [*arguments, "--effects", str(dimmer_file)])
    assert done.exit_code == 0, done.exception
    assert asked[0].effect("dimmer").share == 0.2
