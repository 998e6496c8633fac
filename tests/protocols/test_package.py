"""The package itself: its names, and that importing it costs nothing."""

from __future__ import annotations

import subprocess
import sys

import pytest

import protocols


def test_every_public_name_is_there() -> None:
    for name in protocols.__all__:
        assert getattr(protocols, name) is not None


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = protocols.nothing


def test_importing_it_loads_neither_pydantic_nor_numpy() -> None:
    code = (
        "import sys, protocols, protocols.errors, protocols.points;"
        "print({'pydantic', 'numpy', 'yaml'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
