"""What the documentation says of views is what they say of themselves."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

from bench.diagnosis.expected.parameters import base_parameters
from bench.diagnosis.views.registry import SHOWN, VIEWS

PAGE = Path(__file__).resolve().parents[3] / "docs" / "reference" / "diagnosis.md"


def test_the_page_has_all_views() -> None:
    rows = re.findall(r"^\| `(\w+)` \| (.+) \|$", PAGE.read_text(), re.MULTILINE)
    said = [(v.id, " ".join((inspect.getdoc(v) or "").split("\n\n")[0].split())) for v in (*VIEWS, *SHOWN)]
    assert rows == said


def test_the_page_has_the_numbers_of_the_base_pixel() -> None:
    text = PAGE.read_text()
    for free in base_parameters(refractory_known=False):
        assert f"`{free.key}`" in text
