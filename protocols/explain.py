"""What pydantic finds wrong, in the words of the person who wrote the file, and with its place."""

from __future__ import annotations

import re
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

from protocols.base import CLASS_PATTERN, NAME_PATTERN, PROBLEMS_AT
from protocols.errors import Problem
from protocols.model_keys import keys_at

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from pydantic import BaseModel, ValidationError

    from protocols.yaml_strict import Node

__all__ = ["explain"]

_Path = tuple[str | int, ...]
_WORD = re.compile(r"[\w-]+")


def explain(error: ValidationError, model: type[BaseModel], document: Node, source: str) -> list[Problem]:
    """Return the problems behind a validation error, in the order of the file.

    Parameters
    ----------
    error
        What `model` raised for the value of `document`.
    model
        The model that was asked for.
    document
        The file, with the places of its values.
    source
        Name of the file.

    Returns
    -------
    list of Problem
        Several complaints about one place (a value that fits none of several types) are one problem.
    """
    found: dict[tuple[int, int, str], list[str]] = {}
    for complaint in _without_echoes(list(_complaints(error, model, document))):
        line, column = _place(complaint, document)
        messages = found.setdefault((line, column, _written(complaint.path)), [])
        if complaint.message not in messages:
            messages.append(complaint.message)
    return [
        Problem(f"{path}: {_joined(messages)}" if path else _joined(messages), source, line, column)
        for (line, column, path), messages in sorted(found.items())
    ]


def _joined(messages: list[str]) -> str:
    """Join what is said of one place: keys are missing together, but a value fits one type or another."""
    together = all(message.endswith(" is missing") for message in messages)
    return (" and " if together else " or ").join(messages)


@dataclass(frozen=True, slots=True)
class _Complaint:
    """One thing that is wrong, before it is put into words for a place."""

    path: _Path
    message: str
    missing: str | None = None  #: the key that is missing at `path`
    unknown: bool = False  #: whether the last part of `path` is a key that is not known
    meant: str | None = None  #: the key that was probably meant instead


def _complaints(error: ValidationError, model: type[BaseModel], document: Node) -> Iterator[_Complaint]:
    for details in error.errors(include_url=False):
        loc, kind, context = details["loc"], details["type"], details.get("ctx", {})
        path = _path_in_file(loc, document)
        if kind == PROBLEMS_AT:
            for below, message in context["problems"]:
                yield _Complaint((*path, *below), message)
        elif kind == "missing":
            yield _Complaint(path, f"key {str(loc[-1])!r} is missing", missing=str(loc[-1]))
        elif kind == "extra_forbidden":
            yield _unknown_key(path, str(loc[-1]), keys_at(model, loc[:-1]))
        elif kind == "union_tag_not_found":
            yield _Complaint(path, f"key {context['discriminator']} is missing")
        elif kind == "union_tag_invalid":
            yield _Complaint((*path, context["discriminator"].strip("'")), _wrong_tag(context))
        elif not _counted_invalid_items(kind, context, details["input"]):
            yield _Complaint(path, _message(kind, context, details["input"], details["msg"]))


def _counted_invalid_items(kind: str, context: Mapping[str, Any], value: Any) -> bool:
    """Tell whether a list is only too short because pydantic does not count items that are wrong themselves."""
    return kind == "too_short" and isinstance(value, (list, tuple)) and len(value) >= context["min_length"]


def _without_echoes(complaints: list[_Complaint]) -> list[_Complaint]:
    """Leave out that a key is missing where it is there, mistyped: that is one mistake, not two."""
    mistyped = {(c.path[:-1], c.meant) for c in complaints if c.meant}
    return [c for c in complaints if (c.path, c.missing) not in mistyped]


def _unknown_key(path: _Path, key: str, known: Sequence[str]) -> _Complaint:
    close = get_close_matches(key, known, n=1, cutoff=0.6)
    if close:
        return _Complaint(path, f"unknown key, did you mean {close[0]!r}?", unknown=True, meant=close[0])
    hint = f", known here: {', '.join(known)}" if known else ""
    return _Complaint(path, "unknown key" + hint, unknown=True)


def _path_in_file(loc: Sequence[str | int], document: Node) -> _Path:
    """Return the part of pydantic's location that is in the file: without the names of union members."""
    path: list[str | int] = []
    node = document
    for part in loc:
        if part in node.children:
            path.append(part)
            node = node.children[part]
    return tuple(path)


def _place(complaint: _Complaint, document: Node) -> tuple[int, int]:
    """Return line and column of what the complaint is about: a value, or the key if that is wrong."""
    parent = node = document
    for part in complaint.path:
        if part not in node.children:
            return node.line, node.column
        parent, node = node, node.children[part]
    if complaint.unknown:
        return parent.key_places[str(complaint.path[-1])]
    return node.line, node.column


def _written(path: _Path) -> str:
    """Return ``measurements[0].sweep.contrast``; a key that is not a plain word stands in quotes."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += f".{part}" if _WORD.fullmatch(part) else f".{_shown(part)}"
    return text.removeprefix(".")


def _wrong_tag(context: Mapping[str, Any]) -> str:
    known = [tag.strip().strip("'") for tag in str(context["expected_tags"]).split(",")]
    return _not_one_of(str(context["tag"]), known)


def _not_one_of(value: Any, known: Sequence[str]) -> str:
    if len(known) == 1:
        return f"{_shown(value)} is not {known[0]!r}"
    names = ", ".join(known)
    close = get_close_matches(str(value), known, n=1, cutoff=0.6)
    return f"{_shown(value)} is not one of {names}" + (f", did you mean {close[0]!r}?" if close else "")


def _message(kind: str, context: Mapping[str, Any], value: Any, original: str) -> str:
    """Return what is wrong with a value."""
    if kind in _BOUNDS:
        words, key = _BOUNDS[kind]
        return f"{_shown(value)} is out of range, must be {words} {context[key]:g}"
    if kind in _LENGTHS:
        words, key = _LENGTHS[kind]
        return f"must have {words} {context[key]} item{'' if context[key] == 1 else 's'}"
    if kind in ("literal_error", "enum"):
        return _not_one_of(value, _literals(str(context["expected"])))
    if kind in _TYPES:
        return f"{_shown(value)} is not {_TYPES[kind]}"
    if kind == "value_error":
        return str(context["error"])
    if kind in _OTHERS:
        return _OTHERS[kind](context)
    return original[:1].lower() + original[1:]


_BOUNDS = {
    "greater_than": ("above", "gt"),
    "greater_than_equal": ("at least", "ge"),
    "less_than": ("below", "lt"),
    "less_than_equal": ("at most", "le"),
}
_LENGTHS = {"too_short": ("at least", "min_length"), "too_long": ("at most", "max_length")}
_TYPES = {
    "bool_parsing": "true or false",
    "bool_type": "true or false",
    "dict_type": "a mapping (key: value)",
    "finite_number": "a finite number",
    "float_parsing": "a number",
    "float_type": "a number",
    "int_from_float": "a whole number",
    "int_parsing": "a whole number",
    "int_type": "a whole number",
    "list_type": "a list",
    "model_attributes_type": "a mapping (key: value)",
    "model_type": "a mapping (key: value)",
    "string_type": "text",
    "tuple_type": "a list",
}
#: What the patterns of all schemas ask for, in words.
_PATTERNS = {
    NAME_PATTERN: "must be letters, digits, '_', '.' and '-', and begin with a letter or digit",
    CLASS_PATTERN: "must be a class path, the module, a colon and the class: my_lab.lamp:Lamp",
}
_OTHERS: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "string_too_short": lambda c: (
        "must not be empty" if c["min_length"] == 1 else f"is shorter than {c['min_length']}"
    ),
    "string_too_long": lambda c: f"is longer than {c['max_length']} characters",
    "string_pattern_mismatch": lambda c: _PATTERNS[c["pattern"]],
}


def _literals(expected: str) -> list[str]:
    """Split pydantic's ``'on', 'off' or 'both'``."""
    return [word.strip("'") for word in expected.replace(" or ", ", ").split(", ")]


def _shown(value: Any) -> str:
    """Return a value as a person would name it."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, (list, tuple)):
        return "a list"
    text = repr(value) if isinstance(value, str) else str(value)
    return text if len(text) <= 60 else text[:57] + "..."
