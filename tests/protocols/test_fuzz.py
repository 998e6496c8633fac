"""Whatever a file holds, the answer is a protocol or a list of problems."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from protocols import library, yaml_strict
from protocols.errors import InputError, Problem
from protocols.files import parse_model, read_model
from protocols.schema import Protocol

if TYPE_CHECKING:
    from pathlib import Path

TEXT = library.text("quick_look")
LINES = TEXT.splitlines()
BLOCKS = "[]{}:,-?&*!|>'\"%@#` \n\tab01.~<="


def accepts_or_explains(text: str) -> None:
    problems: tuple[Problem, ...] = ()
    protocol = None
    try:
        protocol = parse_model(text, Protocol, "f.yaml")
    except InputError as error:
        problems = error.problems
    for problem in problems:
        assert str(problem).startswith("f.yaml")
        assert len(str(problem).splitlines()) == 1
    assert problems or (protocol and protocol.expand())


@given(st.text(max_size=200) | st.text(alphabet=BLOCKS, max_size=200))
@settings(max_examples=200, deadline=None, derandomize=True)
def test_any_text(text: str) -> None:
    accepts_or_explains(text)


@given(st.text(alphabet=BLOCKS, max_size=100))
@settings(
    max_examples=200, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_any_text_with_the_python_parser(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(yaml_strict, "_LOADER", yaml.SafeLoader)
        accepts_or_explains(text)


@given(st.binary(max_size=200))
@settings(
    max_examples=200, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_any_bytes(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "f.yaml"
    path.write_bytes(data)
    with pytest.raises(InputError):
        read_model(path, Protocol)


scalars = st.sampled_from(
    [
        "0",
        "-1",
        "1e400",
        "-1e-400",
        "1e308",
        ".inf",
        ".nan",
        "null",
        "on",
        "[]",
        "{}",
        "[[1]]",
        "{a: 1}",
        "'5'",
        "9" * 90,
    ]
)


@given(st.lists(st.tuples(st.integers(0, len(LINES) - 1), scalars), min_size=1, max_size=4))
@settings(max_examples=200, deadline=None, derandomize=True)
def test_a_protocol_with_values_replaced(edits: list[tuple[int, str]]) -> None:
    lines = list(LINES)
    for number, scalar in edits:
        lines[number] = re.sub(r": [^ ].*$", f": {scalar}", lines[number])
    accepts_or_explains("\n".join(lines))


@given(st.lists(st.tuples(st.integers(0, len(TEXT) - 1), st.sampled_from(BLOCKS)), min_size=1, max_size=5))
@settings(max_examples=200, deadline=None, derandomize=True)
def test_a_protocol_with_characters_replaced(edits: list[tuple[int, str]]) -> None:
    text = list(TEXT)
    for place, character in edits:
        text[place] = character
    accepts_or_explains("".join(text))


values: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**50), 10**50) | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


TOP = ("seed", "roi", "expect", "settings", "settle", "pulses", "order", "measurements")
PARTS: list[tuple[str | int, ...]] = [(key,) for key in TOP]
PARTS += [("measurements", 0, key) for key in ("name", "sweep", "stimulus", "settings", "operator")]
PARTS += [("measurements", 0, "sweep", key) for key in ("illuminance_lux", "contrast", "nd_od", "roi", "biases")]


@given(st.sampled_from(PARTS), values)
@settings(max_examples=200, deadline=None, derandomize=True)
def test_a_protocol_with_a_part_replaced(path: tuple[Any, ...], value: Any) -> None:
    data = yaml_strict.read_yaml(TEXT, "quick_look").value
    node = data
    for part in path[:-1]:
        node = node[part]
    node[path[-1]] = value
    accepts_or_explains(yaml.dump(data, allow_unicode=True, Dumper=yaml.CSafeDumper))
