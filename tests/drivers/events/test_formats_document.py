"""The type codes of the decoders against the description of the EVK4's formats."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from drivers.events import evt2_kernels, evt3_kernels

FORMATS = json.loads(
    (Path(__file__).parents[2] / "data" / "evk4" / "evk4_evt_formats.json").read_text(encoding="utf-8")
)


def test_type_codes_of_evt3() -> None:
    for code, word in FORMATS["evt3"]["types"].items():
        if word["name"] != "reserved":
            assert getattr(evt3_kernels, word["name"].removeprefix("EVT_")) == int(code, 16)


@pytest.mark.parametrize("name", ["evt2", "evt21"])
def test_type_codes_of_evt2_and_evt21(name: str) -> None:
    ours = {"EVT_TIME_HIGH": "TIME_HIGH", "EVT_NEG": "CD_OFF", "EVT_POS": "CD_ON"}
    for code, word in FORMATS[name]["types"].items():
        assert getattr(evt2_kernels, ours.get(word, word)) == int(code, 16)
