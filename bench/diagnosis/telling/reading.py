"""A diagnosis as it was written: `diagnosis.json` and the tables beside it."""

from __future__ import annotations

import csv
import json
import math
from typing import TYPE_CHECKING, Any, Final

from bench.diagnosis.result import Candidate, Error, Misfit, Outcome, Remainder, Step, Value
from bench.diagnosis.telling.by_axis import Bin
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

__all__ = ["BINS_FILE", "FORMAT", "JSON_FILE", "read_bins", "read_outcome"]

FORMAT: Final = "evs-bench-diagnosis/1"
JSON_FILE: Final = "diagnosis.json"
BINS_FILE: Final = "by_axis.csv"


def read_outcome(path: Path) -> Outcome:
    """Return the diagnosis in the file `path`; numbers that were not finite are NaN, and there is no model.

    Raises
    ------
    InputError
        The file cannot be read, or is no diagnosis.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["format"] != FORMAT:
            raise InputError(f"{path}: is of format {content['format']!r}; expected {FORMAT!r}")
        return _outcome(content)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"{path}: cannot be read as a diagnosis ({type(error).__name__}: {error}); expected what "
            "'evs-bench diagnose' wrote, make it again"
        ) from None


def _outcome(content: Mapping[str, Any]) -> Outcome:
    quality = content["data_quality"]
    told = tuple(quality["findings"])
    return Outcome(
        runs=tuple(content["runs"]),
        findings=() if quality["ok"] else told,
        steps=tuple(_step(s) for s in content["steps"]),
        verdict=content["verdict"],
        missing=tuple(content["missing"]),
        ties={key: tuple(names) for key, names in content["ties"].items()},
        remainder=tuple(Remainder(**_numbers(r, "size", "z")) for r in content["remainder"]),
        next_measurement={} if content.get("no_measurement_helps", False) else content["next_measurement"],
        shortened=quality.get("looked_at", ""),
        stopped=bool(content.get("stopped", False)),
        cautions=told if quality["ok"] else (),
        not_asked=dict(content.get("not_asked", {})),
    )


def _step(step: Mapping[str, Any]) -> Step:
    return Step(
        number=step["step"],
        added=step["added"],
        effects=tuple(step["effects"]),
        error=Error(**_numbers(step["error"], *step["error"])),
        parameters={key: Value(**_numbers(v, "value", "low", "high")) for key, v in step["parameters"].items()},
        candidates=tuple(_candidate(c) for c in step["candidates"]),
        worst=tuple(Misfit(**_numbers(m, "observed", "predicted", "z")) for m in step["worst"]),
    )


def _candidate(one: Mapping[str, Any]) -> Candidate:
    values = _numbers(one, "screen_drop", "p_value")
    return Candidate(**{**values, "tied_with": tuple(one["tied_with"])})


def _numbers(values: Mapping[str, Any], *names: str) -> dict[str, Any]:
    """Return the values; those that are named and null are NaN."""
    return {k: math.nan if v is None and k in names else v for k, v in values.items()}


def read_bins(path: Path) -> dict[int, tuple[Bin, ...]]:
    """Return the residuals along every axis, by the number of the step; nothing where there is no such file.

    Raises
    ------
    InputError
        The file cannot be read as such a table.
    """
    if not path.exists():
        return {}
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        found: dict[int, list[Bin]] = {}
        for row in rows:
            found.setdefault(int(row["step"]), []).append(_bin(row))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{path}: cannot be read as residuals along axes ({error}); diagnose the run again"
        ) from None
    return {step: tuple(bins) for step, bins in found.items()}


def _bin(row: Mapping[str, str]) -> Bin:
    numbers = {k: float(row[k]) for k in ("low", "high", "mean", "mean_sd", "square", "square_sd")}
    return Bin(axis=row["axis"], view=row["view"], count=int(row["count"]), **numbers)  # type: ignore[arg-type]
