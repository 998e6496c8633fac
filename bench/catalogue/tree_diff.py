"""Where two trees of plain values differ, by path: ``measurements[0].sweep.contrast.values``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

__all__ = ["MISSING", "Difference", "tree_differences", "value_text"]

#: Numbers that differ by less, relatively, are equal: some tools write fewer digits.
_ROUNDING: Final = 1e-9
_LONGEST: Final = 60  #: characters of a value that people are shown


class _Missing:
    """What stands for a value that one of the two has not."""

    def __repr__(self) -> str:
        return "not there"


MISSING: Final = _Missing()


@dataclass(frozen=True, slots=True)
class Difference:
    """One value that is not the same in two runs."""

    path: str
    left: Any  #: in the first; :data:`MISSING` where it is not there
    right: Any

    def __str__(self) -> str:
        """Return the difference as one line."""
        return f"{self.path}: {value_text(self.left)} | {value_text(self.right)}"

    def to_dict(self) -> dict[str, Any]:
        """Return the difference as plain data; a value that is not there is left out."""
        sides = {"left": self.left, "right": self.right}
        return {"path": self.path, **{side: value for side, value in sides.items() if value is not MISSING}}


def tree_differences(left: Any, right: Any, path: str = "") -> Iterator[Difference]:
    """Yield where `left` and `right` differ, in the order of `left`.

    Mappings are compared key by key, lists of mappings by the `name` of their items where all have one, and other
    lists as a whole: a list of numbers is one setting. A key with None is a key that is not there.
    """
    if isinstance(left, dict) and isinstance(right, dict):
        for key in dict.fromkeys([*left, *right]):
            yield from tree_differences(_get(left, key), _get(right, key), _below(path, key))
    elif _are_mappings(left) and _are_mappings(right):
        yield from _in_lists(left, right, path)
    elif not _equal(left, right):
        yield Difference(path, left, right)


def _below(path: str, key: Any) -> str:
    return f"{path}.{_one_line(key)}" if path else _one_line(key)


def _get(mapping: dict[Any, Any], key: Any) -> Any:
    value = mapping.get(key)
    return MISSING if value is None else value


def _are_mappings(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(item, dict) for item in value)


def _in_lists(left: list[dict[Any, Any]], right: list[dict[Any, Any]], path: str) -> Iterator[Difference]:
    names = _names(left), _names(right)
    if None in names:
        pairs: Sequence[tuple[int | None, int | None]] = [
            (i if i < len(left) else None, i if i < len(right) else None) for i in range(max(len(left), len(right)))
        ]
    else:
        pairs = _paired(*names)  # type: ignore[arg-type]
    for i, j in pairs:
        place = f"{path}[{_place(i, j)}]"
        if i is None or j is None:
            items = (left[i] if i is not None else MISSING, right[j] if j is not None else MISSING)
            yield Difference(place, *(_short(item) for item in items))
        else:
            yield from tree_differences(left[i], right[j], place)


def _names(items: list[dict[Any, Any]]) -> list[str] | None:
    """Return the names of the items; None unless each has one of its own."""
    names = [item.get("name") for item in items]
    texts = [name for name in names if isinstance(name, str)]
    return texts if len(set(texts)) == len(items) else None


def _paired(left: list[str], right: list[str]) -> list[tuple[int | None, int | None]]:
    """Return where each name stands in the two lists, in the order of the first, then those only in the second."""
    both: list[tuple[int | None, int | None]] = [
        (i, right.index(name) if name in right else None) for i, name in enumerate(left)
    ]
    return [*both, *((None, j) for j, name in enumerate(right) if name not in left)]


def _place(left: int | None, right: int | None) -> str:
    """Return the place in the list; where it is not the same in both, that of each: ``2 | 1``."""
    if left == right or right is None:
        return str(left)
    return str(right) if left is None else f"{left} | {right}"


def _short(item: Any) -> Any:
    """Return what stands for a whole item that the other has not: its name, if it has one."""
    return item.get("name", item) if isinstance(item, dict) else item


def _equal(left: Any, right: Any) -> bool:
    if isinstance(left, bool) or isinstance(right, bool):
        return left is right
    if isinstance(left, int | float) and isinstance(right, int | float):
        both_unknown = left != left and right != right
        return both_unknown or math.isclose(left, right, rel_tol=_ROUNDING)
    if isinstance(left, list) and isinstance(right, list):
        return len(left) == len(right) and all(_equal(a, b) for a, b in zip(left, right, strict=True))
    if isinstance(left, dict) and isinstance(right, dict):
        return next(tree_differences(left, right), None) is None
    return bool(left == right)


def value_text(value: Any) -> str:
    """Return a value for people, in one short line: a long list of numbers by its number, its ends and so on."""
    if value is MISSING:
        return "-"
    if isinstance(value, list) and len(value) > 4:
        return f"{len(value)} values, {value_text(value[0])} ... {value_text(value[-1])}"
    if isinstance(value, list):
        return f"[{', '.join(value_text(item) for item in value)}]"
    if isinstance(value, dict):
        return _cut("{" + ", ".join(f"{_one_line(key)}: {value_text(item)}" for key, item in value.items()) + "}")
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return _cut(_one_line(value))


def _one_line(value: Any) -> str:
    return " ".join("".join(c if c.isprintable() else " " for c in str(value)).split())


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 4]} ..."
