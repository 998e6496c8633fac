"""Drawing what a blind station is: a base pixel, and effects of random kind and size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, get_args

import numpy as np

from bench.challenge.sizes import ALIKE, SIZES

if TYPE_CHECKING:
    from bench.challenge.sizes import Size

__all__ = ["LEVELS", "Draw", "Level", "draw"]

Level = Literal["easy", "medium", "hard"]
LEVELS: Final[tuple[Level, ...]] = get_args(Level)

#: How often there are 0, 1, 2 and 3 effects, where there may be none.
_EFFECTS: Final[dict[Level, tuple[float, ...]]] = {
    "easy": (0.15, 0.85, 0.0, 0.0),
    "medium": (0.15, 0.5, 0.35, 0.0),
    "hard": (0.2, 0.3, 0.3, 0.2),
}
#: The faintest that an effect may be: 0 is barely visible, 1 is gross.
_FAINTEST: Final[dict[Level, float]] = {"easy": 0.6, "medium": 0.3, "hard": 0.0}

_THRESHOLD_LN: Final = (0.2, 0.4)
_NOISE_LN: Final = (0.02, 0.06)
_CORNER_HZ: Final = (50.0, 500.0)
_DEAD_TIME_S: Final = (1e-3, 10e-3)
#: The smaller threshold in noise rms, at least: below it a pixel fires without end, and nothing else is seen.
_CALM: Final = 5.0
_FIGURES: Final = 4


@dataclass(frozen=True, slots=True)
class Draw:
    """What a blind station is, apart from what all of them have in common."""

    base: dict[str, float]  #: theta_on, theta_off, noise_rms (ln), corner_hz (Hz), refractory_s (s)
    effects: dict[str, dict[str, float]]  #: parameters by name, by effect
    sensor_seed: int


def draw(
    seed: int, level: Level = "medium", effects_count: int | None = None, *, may_be_nothing: bool = False
) -> Draw:
    """Return what a blind station is; the same arguments give the same.

    Parameters
    ----------
    seed
        Of all that is drawn.
    level
        "easy" has one effect, and a large one; "medium" one or two; "hard" one to three, of any size.
    effects_count
        How many effects there are, 0 to 3; None: the level says how often there are how many.
    may_be_nothing
        Sometimes there is no effect at all; it says nothing where `effects_count` is given.
    """
    rng = np.random.default_rng([seed, LEVELS.index(level)])
    number = _number(rng, level, may_be_nothing) if effects_count is None else effects_count
    base = _base(rng)
    chosen = _kinds(rng, number)
    return Draw(base, {i: _sizes(rng, SIZES[i], _FAINTEST[level]) for i in chosen}, int(rng.integers(1 << 32)))


def _number(rng: np.random.Generator, level: Level, may_be_nothing: bool) -> int:
    number = int(rng.choice(len(_EFFECTS[level]), p=_EFFECTS[level]))
    # one instead of none, drawn from the same numbers: a seed that has effects has the same ones either way
    return number if may_be_nothing else max(number, 1)


def _base(rng: np.random.Generator) -> dict[str, float]:
    on, off = rng.uniform(*_THRESHOLD_LN, 2)
    most = min(_NOISE_LN[1], min(on, off) / _CALM)
    exact = {
        "theta_on": on,
        "theta_off": off,
        "noise_rms": rng.uniform(_NOISE_LN[0], most),
        "corner_hz": np.exp(rng.uniform(*np.log(_CORNER_HZ))),
        "refractory_s": np.exp(rng.uniform(*np.log(_DEAD_TIME_S))),
    }
    return {name: float(f"{value:.{_FIGURES}g}") for name, value in exact.items()}


def _kinds(rng: np.random.Generator, number: int) -> list[str]:
    """Return `number` effects, in the order in which a signal passes them."""
    chosen: list[str] = []
    for name in rng.permutation(list(SIZES)).tolist():
        alike = any(name in group and group.intersection(chosen) for group in ALIKE)
        if len(chosen) < number and not alike:
            chosen.append(name)
    return [name for name in SIZES if name in chosen]


def _sizes(rng: np.random.Generator, sizes: tuple[Size, ...], faintest: float) -> dict[str, float]:
    drawn: dict[str, float] = {}
    for size in sizes:
        value = size.at(rng.uniform(0.0 if size.kind else faintest, 1.0))
        drawn[size.name] = -value if size.either_sign and rng.random() < 0.5 else value
    return drawn
