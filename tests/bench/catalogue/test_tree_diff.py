"""Where two trees of values differ."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.catalogue.tree_diff import MISSING, tree_differences, value_text

PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 9) | st.floats(-9, 9) | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=8,
)


def _differences(left: Any, right: Any) -> list[tuple[str, Any, Any]]:
    return [(one.path, one.left, one.right) for one in tree_differences(left, right)]


def test_paths_go_through_keys_and_named_items() -> None:
    left = {"a": {"b": 1}, "m": [{"name": "on", "p": 1}, {"name": "off", "p": 2}], "same": [1, 2]}
    right = {"a": {"b": 2, "c": 3}, "m": [{"name": "off", "p": 4}, {"name": "on", "p": 1}], "same": [1, 2]}
    assert _differences(left, right) == [("a.b", 1, 2), ("a.c", MISSING, 3), ("m[1 | 0].p", 2, 4)]


def test_an_item_that_only_one_has_is_told_by_its_name() -> None:
    left = {"m": [{"name": "on", "p": 1}]}
    right = {"m": [{"name": "on", "p": 1}, {"name": "off", "p": 2}]}
    assert _differences(left, right) == [("m[1]", MISSING, "off")]


def test_lists_of_numbers_are_one_setting() -> None:
    assert _differences({"v": [1, 2, 3]}, {"v": [1, 2]}) == [("v", [1, 2, 3], [1, 2])]


def test_items_without_names_are_compared_in_their_order() -> None:
    assert _differences({"m": [{"p": 1}, {"p": 2}]}, {"m": [{"p": 1}, {"p": 3}]}) == [("m[1].p", 2, 3)]


@pytest.mark.parametrize(
    ("left", "right"),
    [(1, 1.0), (0.1 + 0.2, 0.3), (math.nan, math.nan), ({"a": None}, {}), ([1, 2.0], [1.0, 2])],
)
def test_what_is_equal(left: Any, right: Any) -> None:
    assert _differences({"x": left}, {"x": right}) == []


@pytest.mark.parametrize(("left", "right"), [(1, True), (0, False), (1, "1"), (0.3, 0.3001), ([1], [1, 1])])
def test_what_is_not(left: Any, right: Any) -> None:
    assert len(_differences({"x": left}, {"x": right})) == 1


@given(tree=PLAIN, other=PLAIN)
def test_differences_are_the_same_from_both_sides(tree: Any, other: Any) -> None:
    assert _differences(tree, tree) == []
    there, back = (_differences(*pair) for pair in ((tree, other), (other, tree)))
    assert len(there) == len(back)
    assert all("\n" not in str(one) for one in tree_differences(tree, other))


def test_values_for_people() -> None:
    assert value_text(MISSING) == "-"
    assert value_text([0.1, 0.2, 0.3, 0.4, 0.5]) == "5 values, 0.1 ... 0.5"
    assert value_text(True) == "yes"
    assert value_text(1 / 3) == "0.333333"
    assert value_text("a\nb\x1b[31m") == "a b [31m"
    assert len(value_text("x" * 1000)) == 60
