"""Compare runs of an independent simulator with the model of their parameters; write the tables and figures here.

Run with ``python docs/reference/agreement/measure.py FOLDER [NAME...]``; FOLDER holds the runs practice_1, practice_2
and practice_3 (or those that are named). The second takes ten minutes on two cores, the others one each.
"""

from __future__ import annotations

import csv
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bench.models.compare import compare_run
from bench.models.comparison import within
from bench.report.figures import agreement, style
from bench.store import Run
from sim_backend.pixel import FastEngine, PixelModel, ReferenceEngine
from sim_backend.pixel.effects import DarkCurrent, Leak, ThresholdMismatch

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.models.comparison import Comparison
    from bench.store.data import PointData, RunHeader

HERE = Path(__file__).parent
ENGINE = ReferenceEngine(dt_s=2e-5)  # the grid on which the runs were made
SENSORS = 4
BASE = PixelModel(noise_rms=0.040, corner_hz=120.0, theta_on=0.30, theta_off=0.25, refractory_s=8e-3)
MODELS = {
    "practice_1": BASE + DarkCurrent(mean_fa=8.0),
    "practice_2": BASE + ThresholdMismatch(sigma_on=0.035, sigma_off=0.030) + Leak(rate_per_s=0.12),
    "practice_3": PixelModel(noise_rms=0.045, corner_hz=150.0, theta_on=0.33, theta_off=0.22, refractory_s=8e-3),
}
COLUMNS = (
    "point", "view", "baseline_lux", "log_contrast", "width_s", "pulses", "pixels", "measured", "expected",
    "standard_error", "monte_carlo_error", "z", "informative",
)  # fmt: skip


#: Where the curves of practice_3 are steep, at one light; and the grids on which they are expected.
STEEP = ("practice_3", frozenset([28, 29, 34, 35]))
GRIDS_S = (1e-5, 2e-5, 1e-4)


def main(folder: Path, names: list[str]) -> None:
    """Compare each run, and write its table and figure."""
    for name in names:
        comparison = compare_run(Run.open(folder / name), MODELS[name], engine=ENGINE, sensors=SENSORS)
        write_table(name, comparison)
        write_figure(name, comparison)
        sys.stdout.write(row(name, comparison) + "\n")
        sys.stdout.flush()
    if STEEP[0] in names:
        sys.stdout.writelines(f"{line}\n" for line in grids(folder))


@dataclass(frozen=True, slots=True)
class Part:
    """Some points of a run."""

    run: Run
    chosen: frozenset[int]

    @property
    def header(self) -> RunHeader:
        """Of the run."""
        return self.run.header

    def points(self) -> Iterator[PointData]:
        """Yield those that were chosen."""
        return (p for p in self.run.points() if p.index in self.chosen)


def grids(folder: Path) -> Iterator[str]:
    """Yield the rows of the table of grids: expected ON responses, and the chi-square."""
    name, chosen = STEEP
    for dt_s in GRIDS_S:
        part = Part(Run.open(folder / name), chosen)
        comparison = compare_run(part, MODELS[name], engine=FastEngine(dt_s=dt_s), sensors=2 * SENSORS)
        chi = comparison.chi_square()
        on = [f"{p.expected:.3f} ({p.z:+.1f})" for p in comparison.points if p.view == "response_on"]
        yield f"| {dt_s * 1e6:g} us | {' | '.join(on)} | {chi.value:.1f} / {chi.freedom} | {chi.p_value:.1g} |"


def row(name: str, comparison: Comparison) -> str:
    """Return the row of the table in agreement.md."""
    every, informative = comparison.responses(), comparison.responses(informative=True)
    chi = comparison.chi_square()
    rates = comparison.background()
    cells = [
        f"`{name}`",
        f"{within(every):.1%} of {len(every)}",
        f"{within(informative):.1%} of {len(informative)}",
        f"{max(abs(p.z) for p in every):.1f}",
        f"{chi.value:.1f} / {chi.freedom} = {chi.per_freedom:.2f}",
        f"{chi.p_value:.2f}",
        f"{chi.sum_of_squares:.1f}",
        f"{within(rates):.0%} of {len(rates)}",
    ]
    return f"| {' | '.join(cells)} |"


def write_table(name: str, comparison: Comparison) -> None:
    """Write a line for each view of each point."""
    with (HERE / f"{name}.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for point in comparison.points:
            writer.writerow([_plain(getattr(point, column)) for column in COLUMNS])


def _plain(value: object) -> object:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.5g}"
    return value


def write_figure(name: str, comparison: Comparison) -> None:
    """Write the figure of the run."""
    numbers = agreement.prepare(comparison)
    if numbers is not None:
        with style.house_style():
            agreement.draw(numbers).savefig(HERE / f"{name}.png", dpi=100, metadata={"Software": None})


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:] or list(MODELS))
