"""No effect without its tests: at its null value, of its signature, and against a closed form.

A test says by its mark what it shows of which effects: ``@pytest.mark.effect("leak", shows="signature")``. Tests of
the null value have no ids: they run over the registry.
"""

from __future__ import annotations

import ast
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from sim_backend.pixel.effects import effects

if TYPE_CHECKING:
    from collections.abc import Iterator

TESTS = Path(__file__).resolve().parents[1]
SHOWN = ("null", "signature", "closed_form")
SHIPPED = sorted(name for name, cls in effects().items() if cls.__module__.startswith("sim_backend."))


def marks(function: ast.FunctionDef) -> Iterator[tuple[str, list[str]]]:
    """Yield what the marks of a test say that it shows, and of which effects."""
    for decorator in function.decorator_list:
        if isinstance(decorator, ast.Call) and ast.unparse(decorator.func) == "pytest.mark.effect":
            (shows,) = decorator.keywords
            assert shows.arg == "shows"
            yield ast.literal_eval(shows.value), [ast.literal_eval(arg) for arg in decorator.args]


def runs_over_the_registry(function: ast.FunctionDef) -> bool:
    return any("sorted(effects())" in ast.unparse(decorator) for decorator in function.decorator_list)


def by_effect_and_kind() -> dict[tuple[str, str], list[str]]:
    """Return the names of the tests by effect and by what they show."""
    found: dict[tuple[str, str], list[str]] = {}
    for path in sorted(TESTS.rglob("test_*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                for shows, ids in marks(node):
                    assert shows in SHOWN, f"{node.name}: shows {shows}"
                    assert bool(ids) != runs_over_the_registry(node), f"{node.name}: which effects?"
                    for effect_id in ids or SHIPPED:
                        found.setdefault((effect_id, shows), []).append(node.name)
    return found


FOUND = by_effect_and_kind()


@pytest.mark.parametrize("shows", SHOWN)
@pytest.mark.parametrize("effect_id", SHIPPED)
def test_there_is_a_test(effect_id: str, shows: str) -> None:
    assert FOUND.get((effect_id, shows)), f"{effect_id}: no test is marked as showing its {shows}"


def test_marks_name_effects_that_there_are() -> None:
    assert {effect_id for effect_id, _ in FOUND} <= set(effects())
