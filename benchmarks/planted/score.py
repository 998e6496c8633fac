"""What a diagnosis is worth: its JSON beside the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import permutations
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["Score", "Share", "score", "share", "wilson"]

#: An error of so many times the floor is at the floor.
_WITHIN: Final = 1.1
_Z95: Final = 1.959964
#: Numbers of the base pixel: their names in results, and in a pixel model.
_BASE: Final = {
    "thresholds.on": "theta_on",
    "thresholds.off": "theta_off",
    "noise_floor.rms": "noise_rms",
    "source_follower_bandwidth.corner_hz": "corner_hz",
    "refractory_period.period_s": "refractory_s",
}


@dataclass(frozen=True, slots=True)
class Score:
    """What came of one case."""

    verdict: str
    groups: tuple[tuple[str, ...], ...]  #: what was named, each with what it is tied with, in the order of adding
    first_right: bool  #: the first group holds a planted effect
    all_named: bool  #: each planted effect has a group of its own
    false: int  #: groups that hold no planted effect, or one that another group has
    coverage: dict[str, bool]  #: of each fitted number that has a truth: its 90 % interval contains it
    errors: tuple[float, ...]  #: deviance per degree of freedom, step by step
    unseen: tuple[float, ...]  #: the same on points that the fit did not see
    floor: float  #: what chance leaves of the true model

    @property
    def unexplained(self) -> bool:
        """Whether something was said to be left that no effect of the catalogue explains."""
        return self.verdict == "unexplained"

    @property
    def at_floor(self) -> bool:
        """Whether the last error is within 10 % of the floor."""
        return self._ends_within(self.floor)

    @property
    def is_doubted(self) -> bool:
        """Whether it is said to be explained, and leaves more than chance usually leaves of a true model."""
        return self.verdict == "explained" and not self._ends_within(1.0)

    def _ends_within(self, floor: float) -> bool:
        return bool(self.errors) and self.errors[-1] <= _WITHIN * floor

    @property
    def falls(self) -> bool:
        """Whether the error on unseen points falls at every step."""
        return all(after < before for before, after in zip(self.unseen, self.unseen[1:], strict=False))


@dataclass(frozen=True, slots=True)
class Share:
    """k of n, with the 95 % interval of Wilson."""

    k: int
    n: int

    @property
    def interval(self) -> tuple[float, float]:
        """Lowest and highest share."""
        return wilson(self.k, self.n)

    def __str__(self) -> str:
        """Return it for people."""
        if self.n == 0:
            return "0 of 0"
        low, high = self.interval
        return f"{self.k} of {self.n}, {100 * self.k / self.n:.0f} % ({100 * low:.0f} to {100 * high:.0f})"

    def to_dict(self) -> dict[str, float]:
        """Return plain numbers."""
        low, high = self.interval
        return {"k": self.k, "n": self.n, "low": round(low, 4), "high": round(high, 4)}


def share(marks: Sequence[bool]) -> Share:
    """Return how many of some are true."""
    return Share(sum(marks), len(marks))


def wilson(k: int, n: int, z: float = _Z95) -> tuple[float, float]:
    """Return the interval of Wilson for a share of k in n; from 0 to 1 where nothing was tried.

    Source: E. B. Wilson, "Probable inference, the law of succession, and statistical inference", J. Am. Stat. Assoc.
    22 (1927).
    """
    if n == 0:
        return 0.0, 1.0
    p, q = k / n, z * z / n
    middle = (p + q / 2.0) / (1.0 + q)
    half = math.sqrt(p * (1.0 - p) * q + q * q / 4.0) / (1.0 + q)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def score(truth: Mapping[str, Any], found: Mapping[str, Any], floor: float | None = None) -> Score:
    """Return what a diagnosis is worth.

    Parameters
    ----------
    truth
        :meth:`benchmarks.planted.cases.Case.to_dict`.
    found
        The JSON of a diagnosis, ``evs-bench-diagnosis/1``.
    floor
        What the true model leaves, where it was asked for; if not, what is usual: 1.
    """
    planted = tuple(truth["model"]["effects"])
    wanted = tuple(e for e in planted if e not in truth["left_out"])
    groups = tuple((name, *found["ties"].get(name, ())) for name in found["missing"])
    matched = _most_matches(wanted, groups)
    steps = found["steps"]
    return Score(
        verdict=found["verdict"],
        groups=groups,
        first_right=bool(groups) and any(e in groups[0] for e in wanted),
        all_named=matched == len(wanted),
        false=len(groups) - matched,
        coverage=_coverage(truth, steps[-1]["parameters"]) if steps else {},
        errors=tuple(_number(s["error"]["deviance_per_dof"]) for s in steps),
        unseen=tuple(_number(s["error"]["heldout_deviance_per_dof"]) for s in steps),
        floor=max(float(found["noise_floor"]), floor or 0.0),
    )


def _most_matches(wanted: Sequence[str], groups: Sequence[Sequence[str]]) -> int:
    """Return how many effects can each have a group of their own that holds them."""
    places = max(len(wanted), len(groups))
    padded = [*groups, *([()] * (places - len(groups)))]
    return max(sum(e in g for e, g in zip(wanted, order, strict=False)) for order in permutations(padded))


def _coverage(truth: Mapping[str, Any], fitted: Mapping[str, Mapping[str, Any]]) -> dict[str, bool]:
    """Return for each fitted number whether its interval contains the truth; numbers without a truth are left out."""
    found = {}
    for key, value in fitted.items():
        true = _truth_of(truth["model"], key.partition("@")[0])
        if true is None:
            continue
        low = -math.inf if value["low"] is None else value["low"]
        high = math.inf if value["high"] is None else value["high"]
        found[key] = bool(low <= true <= high)
    return found


def _truth_of(model: Mapping[str, Any], key: str) -> float | None:
    if key in _BASE:
        return float(model[_BASE[key]])
    effect_id, _, name = key.partition(".")
    value = model["effects"].get(effect_id, {}).get(name)
    return None if value is None else float(value)


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
