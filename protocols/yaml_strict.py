"""Reading YAML without its traps.

PyYAML only splits the text into events; what they mean is decided here, by the core schema of YAML 1.2:

- ``on``, ``off``, ``yes`` and ``no`` are text, only ``true`` and ``false`` are truth values;
- ``1e3`` is a number, ``12:30`` and ``2026-11-20`` are text, ``010`` is ten (octal is ``0o10``);
- a key that is given twice is refused, and so are tags (``!!python/...``) and a second document.

Anchors, aliases and merge keys (``<<``) work. What they unfold to is counted, so that a few lines cannot become a
billion values. Keys are always text, as they are written. Nothing in a file is ever executed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import yaml

from protocols.errors import InputError, Problem

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["MOST_CHARACTERS", "MOST_LEVELS", "MOST_VALUES", "Node", "read_yaml"]

MOST_CHARACTERS = 4_000_000  #: in one text
MOST_VALUES = 500_000  #: in one text, aliases unfolded
MOST_LEVELS = 50  #: lists and mappings inside each other
MOST_DIGITS = 100  #: of one number

_NULL = re.compile(r"|~|null|Null|NULL")
_TRUE = re.compile(r"true|True|TRUE")
_FALSE = re.compile(r"false|False|FALSE")
_DECIMAL = re.compile(r"[-+]?[0-9]+")
_OCTAL = re.compile(r"0o[0-7]+")
_HEXADECIMAL = re.compile(r"0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_INFINITE = re.compile(r"[-+]?\.(inf|Inf|INF)")
_NOT_A_NUMBER = re.compile(r"\.(nan|NaN|NAN)")

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the C parser, seven times as fast, where it was built


@dataclass(slots=True)
class Node:
    """A value of a file, with its place and the places of what is in it. Lines and columns count from 1."""

    line: int
    column: int
    value: Any = None
    children: dict[str | int, Node] = field(default_factory=dict)  #: by key or by position in a list
    key_places: dict[str, tuple[int, int]] = field(default_factory=dict)  #: line and column of each key
    size: int = 1  #: number of values in it, itself included


class _Stop(Exception):
    """Reading cannot go on."""


def read_yaml(text: str, source: str) -> Node:
    """Return what one YAML document says.

    Parameters
    ----------
    text
        The document.
    source
        Name of the file, for messages.

    Returns
    -------
    Node
        Its root. The `value` is made of dict, list, str, int, float, bool and None.

    Raises
    ------
    InputError
        With all duplicate keys and tags, or with the first error of syntax or of size.
    """
    if len(text) > MOST_CHARACTERS:
        raise InputError(
            Problem(f"the text has {len(text)} characters, at most {MOST_CHARACTERS} are allowed", source)
        )
    builder = _Builder(source)
    try:
        root = builder.document(text)
    except _Stop:
        root = None
    except yaml.MarkedYAMLError as error:
        builder.add(_syntax_message(error), error.problem_mark or error.context_mark)
        root = None
    except (yaml.YAMLError, ValueError) as error:  # a character that YAML does not allow; a lone surrogate
        builder.add(f"not YAML: {str(error).splitlines()[0]}", None)
        root = None
    if builder.problems or root is None:
        raise InputError(*builder.problems)
    return root


def _syntax_message(error: yaml.MarkedYAMLError) -> str:
    parts = [part for part in (error.context, error.problem) if part]
    return "not YAML: " + ", ".join(parts)


class _Builder:
    """Turns the events of the parser into nodes, and collects what is wrong."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.problems: list[Problem] = []
        self.anchors: dict[str, Node] = {}
        self.values = 0
        self.events: Iterator[Any] = iter(())

    def add(self, message: str, mark: Any) -> None:
        """Add a problem at the place of a parser's mark."""
        line, column = (mark.line + 1, mark.column + 1) if mark is not None else (0, 0)
        self.problems.append(Problem(message, self.source, line, column))

    def document(self, text: str) -> Node:
        """Return the only document in `text`."""
        self.events = iter(yaml.parse(text, Loader=_LOADER))
        root: Node | None = None
        for event in self.events:
            if isinstance(event, yaml.DocumentStartEvent):
                if root is not None:
                    self.add("a second document begins here, one is allowed", event.start_mark)
                    raise _Stop
                root = self.node(next(self.events), 1)
        if root is None:
            self.add("the file is empty", None)
            raise _Stop
        return root

    def node(self, event: Any, level: int) -> Node:
        """Return the node that begins with `event`."""
        if isinstance(event, yaml.AliasEvent):
            return self._alias(event)
        self._count(1, event)
        if level > MOST_LEVELS:
            self.add(f"more than {MOST_LEVELS} lists and mappings inside each other", event.start_mark)
            raise _Stop
        if event.tag not in (None, "!"):
            self.add(f"the tag {_shown(event.tag)} is not allowed, there are no tags here", event.start_mark)
        node = self._content(event, level)
        if event.anchor is not None:
            self.anchors[event.anchor] = node
        return node

    def _content(self, event: Any, level: int) -> Node:
        node = Node(event.start_mark.line + 1, event.start_mark.column + 1)
        if isinstance(event, yaml.ScalarEvent):
            node.value = self._scalar(event)
        elif isinstance(event, yaml.SequenceStartEvent):
            self._fill_list(node, level)
        else:
            self._fill_mapping(node, level)
        node.size += sum(child.size for child in node.children.values())
        return node

    def _count(self, values: int, event: Any) -> None:
        self.values += values
        if self.values > MOST_VALUES:
            self.add(f"more than {MOST_VALUES} values, aliases unfolded", event.start_mark)
            raise _Stop

    def _alias(self, event: Any) -> Node:
        node = self.anchors.get(event.anchor)
        if node is None:
            self.add(f"*{event.anchor} has no anchor before it", event.start_mark)
            raise _Stop
        self._count(node.size, event)
        return node

    def _scalar(self, event: Any) -> Any:
        if event.tag == "!" or event.style not in (None, ""):  # quoted, or a block of text
            return event.value
        try:
            return _plain(event.value)
        except OverflowError as error:
            self.add(str(error), event.start_mark)
            return 0

    def _fill_list(self, node: Node, level: int) -> None:
        node.value = []
        while not isinstance(event := next(self.events), yaml.SequenceEndEvent):
            child = self.node(event, level + 1)
            node.children[len(node.value)] = child
            node.value.append(child.value)

    def _fill_mapping(self, node: Node, level: int) -> None:
        node.value = {}
        merged: list[Node] = []
        while not isinstance(event := next(self.events), yaml.MappingEndEvent):
            key = self._key(event, level)
            child = self.node(next(self.events), level + 1)
            if key == "<<" and event.style in (None, ""):
                merged += self._mappings(child, event.start_mark)
            elif key in node.children:
                line = node.key_places[key][0]
                self.add(f"the key {_shown(key)} is given twice, first on line {line}", event.start_mark)
            elif key is not None:
                _put(node, key, child, (event.start_mark.line + 1, event.start_mark.column + 1))
        for other in merged:
            for name, place in other.key_places.items():
                if name not in node.children:
                    _put(node, name, other.children[name], place)

    def _key(self, event: Any, level: int) -> str | None:
        """Return a key as it is written, or None for one that is not text."""
        if isinstance(event, yaml.ScalarEvent):
            self.node(event, level + 1)
            return str(event.value)
        self.add("a key must be plain text", event.start_mark)
        self.node(event, level + 1)
        return None

    def _mappings(self, node: Node, mark: Any) -> list[Node]:
        """Return the mappings that a merge key names: one, or those of a list."""
        named = list(node.children.values()) if isinstance(node.value, list) else [node]
        if not all(isinstance(n.value, dict) for n in named):
            self.add("<< takes a mapping, or a list of mappings", mark)
            return []
        return named


def _put(node: Node, key: str, child: Node, place: tuple[int, int]) -> None:
    node.children[key] = child
    node.key_places[key] = place
    node.value[key] = child.value


def _plain(text: str) -> Any:
    """Return what a plain scalar says by the core schema of YAML 1.2."""
    if _NULL.fullmatch(text):
        return None
    if _TRUE.fullmatch(text):
        return True
    if _FALSE.fullmatch(text):
        return False
    number = _number(text)
    return text if number is None else number


def _number(text: str) -> int | float | None:
    if _INFINITE.fullmatch(text):
        return -float("inf") if text.startswith("-") else float("inf")
    if _NOT_A_NUMBER.fullmatch(text):
        return float("nan")
    for form, base in ((_DECIMAL, 10), (_OCTAL, 8), (_HEXADECIMAL, 16)):
        if form.fullmatch(text):
            return int(_not_too_long(text), base)
    return float(_not_too_long(text)) if _FLOAT.fullmatch(text) else None


def _not_too_long(text: str) -> str:
    if len(text) > MOST_DIGITS:
        raise OverflowError(f"a number of {len(text)} digits, at most {MOST_DIGITS} are allowed")
    return text


def _shown(text: str) -> str:
    return repr(text if len(text) <= 60 else text[:57] + "...")
