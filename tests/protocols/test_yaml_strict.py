"""Strict YAML: what scalars mean, what is refused, and where things are."""

from __future__ import annotations

import math
from typing import Any

import pytest
import yaml

from protocols import yaml_strict
from protocols.errors import InputError
from protocols.yaml_strict import read_yaml


@pytest.fixture(params=["compiled", "python"], autouse=True)
def parser(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run every test with both of PyYAML's parsers."""
    if request.param == "python":
        monkeypatch.setattr(yaml_strict, "_LOADER", yaml.SafeLoader)


def value(text: str) -> Any:
    return read_yaml(text, "f.yaml").value


def problems(text: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        read_yaml(text, "f.yaml")
    return [str(p) for p in caught.value.problems]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("on", "on"),
        ("off", "off"),
        ("yes", "yes"),
        ("No", "No"),
        ("true", True),
        ("FALSE", False),
        ("1e3", 1000.0),
        ("1E-3", 0.001),
        ("-.5", -0.5),
        ("5.", 5.0),
        ("12:30", "12:30"),
        ("2026-11-20", "2026-11-20"),
        ("010", 10),
        ("-010", -10),
        ("0o10", 8),
        ("0x1F", 31),
        ("1_000", "1_000"),
        ("+7", 7),
        ("~", None),
        ("null", None),
        ("", None),
        ("'5'", "5"),
        ('"true"', "true"),
        ("! 5", "5"),
        ("-.inf", -math.inf),
        ("=", "="),
        ("10 ms", "10 ms"),
    ],
)
def test_scalars_mean_what_yaml_1_2_says(text: str, expected: Any) -> None:
    found = value(f"key: {text}")["key"]
    assert found == expected
    assert type(found) is type(expected)


def test_not_a_number_is_a_number() -> None:
    assert math.isnan(value("key: .nan")["key"])


def test_keys_are_text_as_written() -> None:
    assert value("{on: 1, 1e3: 2, null: 3, 010: 4}") == {"on": 1, "1e3": 2, "null": 3, "010": 4}


def test_every_duplicate_key_is_named_with_both_lines() -> None:
    text = "a: 1\nb:\n  c: 1\n  c: 2\na: 3\n"
    assert problems(text) == [
        "f.yaml:4:3: the key 'c' is given twice, first on line 3",
        "f.yaml:5:1: the key 'a' is given twice, first on line 1",
    ]


def test_keys_are_duplicates_however_they_are_quoted() -> None:
    assert problems("a: 1\n'a': 2\n") == ["f.yaml:2:1: the key 'a' is given twice, first on line 1"]


def test_tags_are_refused_and_not_executed() -> None:
    text = "a: !!python/object/apply:os.system ['exit 1']\nb: !!str 5\n"
    found = problems(text)
    assert len(found) == 2
    assert found[0].startswith("f.yaml:1:4: the tag 'tag:yaml.org,2002:python/object/apply:os.system'")
    assert found[1].startswith("f.yaml:2:4: the tag 'tag:yaml.org,2002:str'")


def test_anchors_aliases_and_merge_keys_work() -> None:
    text = "base: &base {a: 1, b: 2}\nlist: [*base, *base]\nmerged:\n  b: 3\n  <<: *base\n"
    found = value(text)
    assert found["list"] == [{"a": 1, "b": 2}, {"a": 1, "b": 2}]
    assert found["merged"] == {"b": 3, "a": 1}


def test_the_first_of_several_merged_mappings_wins() -> None:
    text = "x: &x {a: 1}\ny: &y {a: 2, b: 2}\nz:\n  <<: [*x, *y]\n"
    assert value(text)["z"] == {"a": 1, "b": 2}


def test_a_quoted_merge_key_is_a_key() -> None:
    assert value("'<<': 5") == {"<<": 5}


def test_a_merge_key_takes_mappings_only() -> None:
    assert problems("a:\n  <<: 5\n") == ["f.yaml:2:3: << takes a mapping, or a list of mappings"]


def test_places_are_those_of_the_file() -> None:
    root = read_yaml("top:\n  list:\n    - 1\n    - {deep: text}\nbase: &b {k: 1}\nuse:\n  <<: *b\n", "f.yaml")
    deep = root.children["top"].children["list"].children[1]
    assert (deep.line, deep.column) == (4, 7)
    assert deep.key_places["deep"] == (4, 8)
    assert (deep.children["deep"].line, deep.children["deep"].column) == (4, 14)
    assert root.children["use"].key_places["k"] == (5, 11)


def test_an_alias_bomb_is_refused() -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 30)]
    (only,) = problems("\n".join(lines))
    assert "more than 500000 values, aliases unfolded" in only


def test_an_alias_of_what_contains_it_is_refused() -> None:
    assert problems("a: &a [1, *a]") == ["f.yaml:1:11: *a has no anchor before it"]


@pytest.mark.parametrize("text", ["[" * 2000, "- " * 400 + "x", "{a: " * 200, "? " * 200 + "x"])
def test_deep_nesting_is_refused(text: str) -> None:
    assert "more than 50 lists and mappings inside each other" in problems(text)[-1]


def test_fifty_levels_are_fine() -> None:
    assert value("[" * 49 + "1" + "]" * 49)


def test_a_key_that_is_a_list_is_refused() -> None:
    assert problems("? [1, 2]\n: 3\n") == ["f.yaml:1:3: a key must be plain text"]


def test_a_second_document_is_refused() -> None:
    assert problems("a: 1\n---\nb: 2\n") == ["f.yaml:2:1: a second document begins here, one is allowed"]


def test_an_empty_file_is_refused() -> None:
    assert problems("# nothing\n") == ["f.yaml: the file is empty"]


def test_an_error_of_syntax_has_a_place() -> None:
    (only,) = problems("a: [1, 2\nb: 3\n")
    assert only.startswith("f.yaml:2:")
    assert "not YAML" in only


def test_a_tab_as_indent_is_an_error_of_one_line() -> None:
    (only,) = problems("a:\n\tb: 1\n")
    assert only.startswith("f.yaml:2:1: not YAML")
    assert "\n" not in only


@pytest.mark.parametrize("text", ["a: \x07", "a: \ud800", "\x00"])
def test_characters_that_yaml_forbids_are_one_line(text: str) -> None:
    (only,) = problems(text)
    assert only.startswith("f.yaml")
    assert "\n" not in only


def test_a_number_of_a_thousand_digits_is_refused() -> None:
    (only,) = problems("a: " + "9" * 1000)
    assert only == "f.yaml:1:4: a number of 1000 digits, at most 100 are allowed"


def test_the_text_has_a_limit() -> None:
    (only,) = problems("a" * (yaml_strict.MOST_CHARACTERS + 1))
    assert "characters" in only
