"""A diagnosis, or a comparison, as files: JSON, the model, and tables of residuals."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Any, Final

from bench.diagnosis.comparison import Residual
from bench.diagnosis.result import quality_dict
from bench.diagnosis.telling.by_axis import UNITS, Bin, by_axis, worst_places
from bench.diagnosis.telling.reading import BINS_FILE, JSON_FILE
from bench.plain import json_text
from bench.store.durable import write_whole
from bench.store.layout import PART_SUFFIX
from sim_backend.pixel.model_file import model_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from bench.diagnosis.comparison import Comparison, ResidualsByStep
    from bench.diagnosis.recorded.position import Pattern
    from bench.diagnosis.result import Outcome

__all__ = [
    "COMPARISON_FILE",
    "COMPARISON_FORMAT",
    "MODEL_FILE",
    "RESIDUALS_FILE",
    "comparison_dict",
    "save_comparison",
    "save_outcome",
]

MODEL_FILE: Final = "model.yaml"
RESIDUALS_FILE: Final = "residuals.csv"
COMPARISON_FILE: Final = "comparison.json"
COMPARISON_FORMAT: Final = "evs-bench-comparison/1"


def save_outcome(outcome: Outcome, folder: Path, residuals: ResidualsByStep | None = None) -> None:
    """Write a diagnosis into `folder`: diagnosis.json, model.yaml, residuals.csv and by_axis.csv.

    Each file is whole or absent. What an earlier diagnosis left, and this one has not, goes once the JSON is there.

    Parameters
    ----------
    residuals
        By the number of the step: residuals, and their correlation where it is known.
    """
    if residuals:
        _save_residuals(residuals, folder)
    if outcome.model is not None:
        _write(folder / MODEL_FILE, model_text(outcome.model))
    _write(folder / JSON_FILE, json_text(outcome.to_dict()) + "\n")
    # What is left of an earlier diagnosis would be taken for this one's.
    for name, is_new in ((RESIDUALS_FILE, residuals), (BINS_FILE, residuals), (MODEL_FILE, outcome.model)):
        if not is_new:
            (folder / name).unlink(missing_ok=True)


def comparison_dict(comparison: Comparison, patterns: Sequence[Pattern]) -> dict[str, Any]:
    """Return a comparison as plain numbers and texts."""
    step = comparison.step.to_dict()
    return {
        "format": COMPARISON_FORMAT,
        "runs": list(comparison.runs),
        "data_quality": quality_dict(comparison.findings, comparison.shortened, comparison.cautions),
        "noise_floor": 1.0,
        "effects": step["effects"],
        "error": step["error"],
        "parameters": step["parameters"],
        "worst": [asdict(p) for p in worst_places(comparison.residuals, comparison.correlation)],
        "axes": [asdict(b) for b in by_axis(comparison.residuals, comparison.correlation)],
        "pixels": [asdict(p) for p in patterns],
        "residuals": [asdict(r) for r in comparison.residuals],
    }


def save_comparison(comparison: Comparison, content: Mapping[str, Any], folder: Path) -> None:
    """Write a comparison into `folder`: comparison.json with `content`, model.yaml and both tables of residuals."""
    _save_residuals({0: (comparison.residuals, comparison.correlation)}, folder)
    _write(folder / MODEL_FILE, model_text(comparison.model))
    _write(folder / COMPARISON_FILE, json_text(content) + "\n")


def _save_residuals(residuals: ResidualsByStep, folder: Path) -> None:
    rows = [{"step": n, **asdict(r)} for n, (mine, _) in residuals.items() for r in mine]
    bins = [
        {"step": n, **asdict(b), "unit": UNITS[b.axis]}
        for n, (mine, mutual) in residuals.items()
        for b in by_axis(mine, mutual)
    ]
    _write(folder / RESIDUALS_FILE, _csv(("step", *(f.name for f in fields(Residual))), rows))
    _write(folder / BINS_FILE, _csv(("step", *(f.name for f in fields(Bin)), "unit"), bins))


def _csv(head: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, head, lineterminator="\n")
    writer.writeheader()
    writer.writerows({k: _cell(v) for k, v in row.items()} for row in rows)
    return text.getvalue()


def _cell(value: Any) -> Any:
    if not isinstance(value, float):
        return value
    return f"{value:.6g}" if math.isfinite(value) else ""


def _write(path: Path, text: str) -> None:
    write_whole(path, text, PART_SUFFIX)
