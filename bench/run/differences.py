"""What differs between what a run says of its station and what is there now, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["differences"]

_NOT_THERE: Final = object()


def differences(before: Any, now: Any) -> tuple[str, ...]:
    """Return where two trees of plain values differ, each place with what was there and what is there now."""
    return tuple(_differences(before, now, ""))


def _differences(before: Any, now: Any, where: str) -> Iterator[str]:
    if isinstance(before, dict) and isinstance(now, dict):
        for key in dict.fromkeys((*before, *now)):
            below = f"{where}.{key}" if where else str(key)
            yield from _differences(before.get(key, _NOT_THERE), now.get(key, _NOT_THERE), below)
    elif isinstance(before, (list, tuple)) and isinstance(now, (list, tuple)) and len(before) == len(now):
        for number, (old, new) in enumerate(zip(before, now, strict=True)):
            yield from _differences(old, new, f"{where}[{number}]")
    elif before != now and not (before != before and now != now):  # NaN is NaN
        yield f"{where} was {_shown(before)}, and is {_shown(now)} now"


def _shown(value: Any) -> str:
    if value is _NOT_THERE:
        return "not there"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
