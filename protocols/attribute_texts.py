"""The texts that stand below the fields of a model, for the JSON Schema: they are in the source and nowhere else."""

from __future__ import annotations

import ast
import inspect
import textwrap
from itertools import pairwise

__all__ = ["texts_below_fields"]


def texts_below_fields(model: type) -> dict[str, str]:
    """Return the text below each annotated field of a class and of those that it extends, by name of the field."""
    found: dict[str, str] = {}
    for one in reversed(model.__mro__[:-1]):
        if one.__module__.partition(".")[0] != "pydantic":
            found |= _own_texts(one)
    return found


def _own_texts(model: type) -> dict[str, str]:
    (body,) = ast.parse(textwrap.dedent(inspect.getsource(model))).body
    statements = body.body if isinstance(body, ast.ClassDef) else []
    return {
        field.target.id: inspect.cleandoc(below.value.value)
        for field, below in pairwise(statements)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(below, ast.Expr)
        and isinstance(below.value, ast.Constant)
        and isinstance(below.value.value, str)
    }
