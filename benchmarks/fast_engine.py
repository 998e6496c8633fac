"""Print the time per pixel and second of both engines at all settings, side by side, with their statistics beside it.

Repeats of both engines in turn, the shortest counts; one thread, and the processor's time, so that other programs
matter little. Look at the ratio: both engines share whatever slows the processor down. The goals stand below the
table with what was measured. Names of settings may be given::

    python benchmarks/fast_engine.py "200 Hz, 10 ms" "leak"
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from protocols.points import Roi
from sim_backend.pixel import FastEngine, ReferenceEngine
from sim_backend.pixel.engines.compare import Figures, Pulses, figures
from sim_backend.pixel.engines.settings import SETTINGS, setting

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sim_backend.pixel.engines.base import Engine
    from sim_backend.pixel.engines.settings import Setting

ROI = Roi(0, 0, 32, 16)
DURATION_S = 4.0
WARM_UP_S = 0.2
REPEATS = 5
ENGINES: tuple[Engine, Engine] = (ReferenceEngine(threads=1), FastEngine(threads=1))
WIDTH = max(len(s.name) for s in SETTINGS)

MOST_SLOWER = 0.9  # ratio of a setting at which the fast engine is 10 % slower


@dataclass(frozen=True, slots=True)
class Row:
    """One setting, measured: the reference engine first."""

    setting: Setting
    us: tuple[float, float]  #: for each pixel and second
    figures: tuple[Figures, Figures]

    @property
    def ratio(self) -> float:
        """How many times as fast the fast engine is."""
        return self.us[0] / self.us[1]


@dataclass(frozen=True, slots=True)
class Goal:
    """A figure that is wanted at some settings."""

    text: str
    concerns: Callable[[Setting], bool]
    worst: Callable[[Sequence[Row]], Row]
    value: Callable[[Row], float]
    met: Callable[[float], bool]


def _lowest_ratio(rows: Sequence[Row]) -> Row:
    return min(rows, key=lambda r: r.ratio)


def _longest(rows: Sequence[Row]) -> Row:
    return max(rows, key=lambda r: r.us[1])


def _is_plain_square(s: Setting) -> bool:
    return (
        not s.model.effects
        and s.stimulus.kind == "square"
        and s.apart >= 4.5
        and s.model.corner_hz in (50.0, 200.0, 2000.0)
    )


def _is_one_pole(s: Setting) -> bool:
    return s.poles == 1 and s.apart >= 4.5


def _is_two_poles(s: Setting) -> bool:
    return (
        s.poles == 2
        and s.model.effect("shot_noise") is not None
        and s.model.effect("photoreceptor_bandwidth") is not None
    )


GOALS = (
    Goal(
        "one pole, square wave of 5 Hz, theta/rms 4.5 or more, 50, 200 and 2000 Hz: 40 times or more",
        _is_plain_square, _lowest_ratio, lambda r: r.ratio, lambda v: v >= 40.0,
    ),
    Goal(
        "two poles and shot noise: 8 times or more",
        _is_two_poles, _lowest_ratio, lambda r: r.ratio, lambda v: v >= 8.0,
    ),
    Goal(
        "every setting: no more than 10 % slower",
        lambda _: True, _lowest_ratio, lambda r: r.ratio, lambda v: v >= MOST_SLOWER,
    ),
    Goal(
        "one pole, theta/rms 4.5 or more: 10 us per pixel and second or less",
        _is_one_pole, _longest, lambda r: r.us[1], lambda v: v <= 10.0,
    ),
    Goal(
        "two poles and shot noise: 45 us per pixel and second or less",
        _is_two_poles, _longest, lambda r: r.us[1], lambda v: v <= 45.0,
    ),
)  # fmt: skip


def pulses_of(one: Setting, duration_s: float) -> Pulses:
    """Return the pulses of a recording of this length."""
    return one.pulses(ROI, one.chain(ROI).pixels * duration_s)


def measure(one: Setting) -> Row:
    """Return times and figures of both engines, taken in turn; the first recordings, which compile, do not count."""
    pulses = pulses_of(one, DURATION_S)
    pixels = one.chain(ROI).pixels
    for engine in ENGINES:
        one.events(engine, pulses_of(one, WARM_UP_S), 1)
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(REPEATS):
        for engine, taken in zip(ENGINES, times, strict=True):
            start = time.process_time()
            one.events(engine, pulses, 1)
            taken.append(time.process_time() - start)
    to_us = 1e6 / pulses.duration_s / pixels
    slow, fast = (figures(one.events(engine, pulses, seed), pulses, pixels) for seed, engine in enumerate(ENGINES, 1))
    return Row(one, (min(times[0]) * to_us, min(times[1]) * to_us), (slow, fast))


def show(row: Row) -> None:
    """Print a row."""
    slow, fast = row.figures
    pairs = "  ".join(
        f"{getattr(slow, name):7.3f} {getattr(fast, name):7.3f}"
        for name in ("events", "on_response", "on_latency_ms")
    )
    print(f"{row.setting.name:{WIDTH}}  {row.us[0]:9.1f}  {row.us[1]:6.2f}  {row.ratio:5.1f}  {pairs}", flush=True)


def summary(rows: Sequence[Row]) -> None:
    """Print each goal with the setting that is worst."""
    print("goals, and the setting that is worst")
    for goal in GOALS:
        mine = [row for row in rows if goal.concerns(row.setting)]
        if mine:
            worst = goal.worst(mine)
            value = goal.value(worst)
            verdict = "met" if goal.met(value) else "NOT met"
            met = sum(goal.met(goal.value(row)) for row in mine)
            print(f"  {goal.text}\n    {verdict}: {value:.3g} at {worst.setting.name}; {met} of {len(mine)} settings")


def main(names: Sequence[str]) -> None:
    """Measure and print."""
    print(f"{ROI.pixels} pixels, {DURATION_S:g} s, one thread; processor time, us per pixel and second; pairs: both")
    print(f"{'':{WIDTH}}  reference    fast  ratio  events a period  ON response      latency, ms")
    rows = []
    for one in [setting(name) for name in names] or SETTINGS:
        rows.append(measure(one))
        show(rows[-1])
    summary(rows)


if __name__ == "__main__":
    main(sys.argv[1:])
