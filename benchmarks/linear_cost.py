"""Show that the cost of a recording grows linearly with pixels and with pulses, for both engines; draw it.

Run with ``python benchmarks/linear_cost.py FIGURE.png``; without a name it only prints. One thread, the processor's
time, the shortest of some repeats. The exponent is that of a power law through the points, 1 where cost is linear; at
the small end it is lower, since a recording has a fixed cost too.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from protocols.points import Roi
from sim_backend.pixel import FastEngine, ReferenceEngine
from sim_backend.pixel.engines.settings import setting

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel.engines.base import Engine

ENGINES: dict[str, Engine] = {"reference": ReferenceEngine(threads=1), "fast": FastEngine(threads=1)}
SETTING = setting("200 Hz, 10 ms")
#: pixels are 32 wide; rows, and pulses of each pixel
ROWS = (8, 16, 32, 64, 128)
PULSES = (5, 10, 20, 40, 80)
FEW_ROWS, FEW_PULSES = 8, 5
WIDTH = 32
REPEATS = 3


@dataclass(frozen=True, slots=True)
class Series:
    """Cost over one quantity."""

    label: str
    size: npt.NDArray[np.float64]  #: (n,)
    cost_s: dict[str, npt.NDArray[np.float64]]  #: (n,) of each engine


def cost_s(engine: Engine, rows: int, pulses: int) -> float:
    """Return the processor's time of a recording, s."""
    roi = Roi(0, 0, WIDTH, rows)
    asked = SETTING.pulses(roi, roi.pixels * pulses * SETTING.stimulus.period_s)
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        SETTING.events(engine, asked, 1)
        times.append(time.process_time() - start)
    return min(times)


def measure() -> tuple[Series, Series]:
    """Return the cost over pixels and over pulses."""
    for engine in ENGINES.values():
        cost_s(engine, FEW_ROWS, 1)
    by_pixels = {name: np.array([cost_s(e, rows, FEW_PULSES) for rows in ROWS]) for name, e in ENGINES.items()}
    by_pulses = {name: np.array([cost_s(e, FEW_ROWS, n) for n in PULSES]) for name, e in ENGINES.items()}
    return (
        Series(f"pixels ({FEW_PULSES} pulses each)", WIDTH * np.array(ROWS, np.float64), by_pixels),
        Series(f"pulses of a pixel ({WIDTH * FEW_ROWS} pixels)", np.array(PULSES, np.float64), by_pulses),
    )


def exponent(size: npt.NDArray[np.float64], cost: npt.NDArray[np.float64]) -> float:
    """Return the exponent of the power law through the points."""
    return float(np.polyfit(np.log(size), np.log(cost), 1)[0])


def draw(series: tuple[Series, Series], path: Path) -> None:
    """Draw cost over pixels and over pulses."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 3.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 2, sharey=True)
    styles = {"reference": ("#0072B2", "o"), "fast": ("#D55E00", "s")}
    for ax, one in zip(axes, series, strict=True):
        for name, cost in one.cost_s.items():
            color, marker = styles[name]
            label = f"{name}: exponent {exponent(one.size, cost):.2f}"
            ax.loglog(one.size, cost, marker=marker, color=color, linestyle="none", label=label)
            middle = float(np.exp(np.mean(np.log(cost / one.size))))
            ax.loglog(one.size, middle * one.size, color=color, linewidth=1.0)
        ax.set_xticks(one.size, [f"{n:g}" for n in one.size])
        ax.minorticks_off()
        ax.set_xlabel(one.label)
        ax.grid(visible=True, which="major", linewidth=0.4, alpha=0.5)
        ax.legend(frameon=False, fontsize=8, loc="upper left")
        ax.set_ylim(top=8.0 * max(float(c.max()) for s in series for c in s.cost_s.values()))
    axes[0].set_ylabel("processor time, s")
    figure.savefig(path, dpi=130)


def main(arguments: list[str]) -> None:
    """Measure, print, and draw if a file is named."""
    series = measure()
    print(f"{SETTING.name}, square wave of 5 Hz, one thread; seconds of the processor")
    for one in series:
        print(one.label)
        for name, cost in one.cost_s.items():
            costs = "  ".join(f"{n:g}: {c:.4f}" for n, c in zip(one.size, cost, strict=True))
            print(f"  {name:9}  exponent {exponent(one.size, cost):.3f}   {costs}")
    if arguments:
        draw(series, Path(arguments[0]))


if __name__ == "__main__":
    main(sys.argv[1:])
