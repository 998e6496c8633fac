"""A pixel model in a file of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from protocols.errors import InputError
from sim_backend.pixel import PixelModel, model_text, read_model_file
from sim_backend.pixel.effects import LightFlicker, PhotoreceptorBandwidth, effects

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("effect_id", sorted(effects()))
def test_a_model_with_any_effect_survives_its_file(effect_id: str, tmp_path: Path) -> None:
    cls = effects()[effect_id]
    for effect in (cls(), cls.null()):
        model = PixelModel(theta_on=0.2) + effect
        (tmp_path / "model.yaml").write_text(model_text(model))
        assert read_model_file(tmp_path / "model.yaml") == model


def test_a_file_may_name_only_what_differs(tmp_path: Path) -> None:
    file = tmp_path / "model.yaml"
    file.write_text(
        "format: evs-bench-model/1\ntheta_on: 0.2\n"
        "effects:\n  light_flicker: {depth: 0.1, phase: 1.5}\n  photoreceptor_bandwidth: {max_hz: .inf}\n"
    )
    flicker, receptor = LightFlicker(depth=0.1, phase=1.5), PhotoreceptorBandwidth(max_hz=float("inf"))
    assert read_model_file(file) == PixelModel(theta_on=0.2) + flicker + receptor


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("theta_on: 0.2", r"model\.yaml: is no pixel model; expected 'format: evs-bench-model/1'"),
        ("[1, 2]", "is no pixel model"),
        ("format: evs-bench-model/1\neffects: {leek: {}}", r"model\.yaml: unknown effect 'leek'; did you mean leak"),
        ("format: evs-bench-model/1\ntheta_on: -1", r"model\.yaml: pixel model: theta_on is -1"),
        ("format: evs-bench-model/1\ntheta_on: 0.2\ntheta_on: 0.3", r"model\.yaml:3"),
    ],
)
def test_what_is_wrong_is_named_with_the_file(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "model.yaml").write_text(text)
    with pytest.raises(InputError, match=message):
        read_model_file(tmp_path / "model.yaml")


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_model_file(tmp_path / "model.yaml")
