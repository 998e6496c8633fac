"""What a diagnosis of a blind station is worth: effects named right, wrongly or missed, and numbers in intervals."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final

from protocols.errors import InputError
from protocols.files import read_text

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from bench.challenge.truth import Number, Truth
    from bench.store import Run

__all__ = ["Named", "Score", "Scored", "read_diagnosis", "require_diagnosis_of", "score"]

_FORMAT: Final = "evs-bench-diagnosis/1"


@dataclass(frozen=True, slots=True)
class Named:
    """An effect that a diagnosis names, and those that it cannot tell from it."""

    effect: str
    tied_with: tuple[str, ...]
    truth: str | None  #: the true effect that it stands for; None: it is named wrongly


@dataclass(frozen=True, slots=True)
class Scored:
    """A true number beside what a diagnosis says of it."""

    key: str
    truth: float
    unit: str
    value: float | None  #: None where the diagnosis does not tell it
    low: float | None  #: of its 90 % interval; None: open
    high: float | None

    @property
    def told(self) -> bool:
        """Whether the diagnosis tells it."""
        return self.value is not None

    @property
    def inside(self) -> bool:
        """Whether the truth is in the interval."""
        low = -math.inf if self.low is None else self.low
        high = math.inf if self.high is None else self.high
        return self.told and low <= self.truth <= high


@dataclass(frozen=True, slots=True)
class Score:
    """A diagnosis beside the truth."""

    named: tuple[Named, ...]
    missed: tuple[str, ...]
    numbers: tuple[Scored, ...]

    @property
    def right(self) -> tuple[Named, ...]:
        """What is named and there, alone or in a tied group."""
        return tuple(n for n in self.named if n.truth is not None)

    @property
    def wrong(self) -> tuple[Named, ...]:
        """What is named and not there."""
        return tuple(n for n in self.named if n.truth is None)

    @property
    def verdict(self) -> str:
        """One line."""
        return f"{_effects_line(len(self.right), len(self.missed), len(self.wrong))}; {self._numbers_line()}"

    def _numbers_line(self) -> str:
        told = [n for n in self.numbers if n.told]
        inside = sum(n.inside for n in told)
        return f"{inside} of {len(told)} numbers that were told lie in their 90 % intervals"

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            "right": [asdict(n) for n in self.right],
            "wrong": [asdict(n) for n in self.wrong],
            "missed": list(self.missed),
            "parameters": [{**asdict(n), "inside": n.inside if n.told else None} for n in self.numbers],
            "told": sum(n.told for n in self.numbers),
            "inside": sum(n.inside for n in self.numbers),
            "verdict": self.verdict,
        }


def _effects_line(right: int, missed: int, wrong: int) -> str:
    there = right + missed
    if not there:
        return (
            "nothing was missing, and nothing was named" if not wrong else f"nothing was missing, but {wrong} named"
        )
    found = f"all {there}" if not missed and there > 1 else f"{right} of {there}"
    return f"found {found} effect{'s' * (there > 1)}, {wrong or 'none'} named wrongly"


def read_diagnosis(path: Path) -> dict[str, Any]:
    """Return what `evs-bench diagnose --json` printed.

    Raises
    ------
    InputError
        The file cannot be read, or is no diagnosis of this format.
    """
    try:
        found = json.loads(read_text(path))
    except ValueError as error:
        raise InputError(f"{path}: is no JSON: {error}") from None
    if not isinstance(found, dict) or found.get("format") != _FORMAT:
        raise InputError(f"{path}: is no diagnosis; expected the format {_FORMAT}")
    if not isinstance(found.get("steps"), list) or not isinstance(found.get("missing"), list):
        raise InputError(f"{path}: steps or missing are not there; was it written to its end?")
    return found


def require_diagnosis_of(runs: Sequence[Run], diagnosis: Mapping[str, Any], path: Path) -> None:
    """Raise where a diagnosis is one of other runs than these, or of these in another order.

    Parameters
    ----------
    path
        The file of the diagnosis, to be named in an error.

    Raises
    ------
    InputError
        They are not the diagnosed ones.
    """
    named = [run.header.id for run in runs]
    told = [str(run) for run in diagnosis.get("runs") or ()]
    if told != named:
        raise InputError(
            f"{path}: is a diagnosis of {', '.join(told) or 'no run'}; expected one of the runs that --run names, "
            f"in their order: {', '.join(named)}"
        )


def score(truth: Truth, diagnosis: Mapping[str, Any], settings: Sequence[Mapping[str, int]] = ({},)) -> Score:
    """Return what a diagnosis is worth.

    Parameters
    ----------
    diagnosis
        As :func:`read_diagnosis` returns it.
    settings
        Bias offsets of the runs that were diagnosed; see :meth:`~bench.challenge.truth.Truth.numbers`.
    """
    ties = diagnosis.get("ties") or {}
    groups = [(str(name), tuple(map(str, ties.get(name, ())))) for name in diagnosis["missing"]]
    stands_for = _assigned([(name, *tied) for name, tied in groups], list(truth.effects))
    named = tuple(Named(name, tied, t) for (name, tied), t in zip(groups, stands_for, strict=True))
    missed = tuple(effect for effect in truth.effects if effect not in stands_for)
    told = diagnosis["steps"][-1].get("parameters", {}) if diagnosis["steps"] else {}
    return Score(named, missed, tuple(_scored(n, told.get(n.key)) for n in truth.numbers(settings)))


def _assigned(groups: Sequence[Sequence[str]], truth: Sequence[str]) -> list[str | None]:
    """Return for each group the true effect that it stands for: as many as can be, each true effect once.

    A group stands for what it names first, where that is true.
    """
    if not groups:
        return []
    first, rest = groups[0], groups[1:]
    choices: list[str | None] = [effect for effect in first if effect in truth]
    best: list[str | None] = []
    for choice in (*choices, None):
        found = [choice, *_assigned(rest, [t for t in truth if t != choice])]
        if not best or _matches(found) > _matches(best):
            best = found
    return best


def _matches(found: Sequence[str | None]) -> int:
    return sum(choice is not None for choice in found)


def _scored(number: Number, told: Mapping[str, Any] | None) -> Scored:
    value, low, high = ((told or {}).get(key) for key in ("value", "low", "high"))
    return Scored(number.key, number.value, number.unit, value, low, high)
