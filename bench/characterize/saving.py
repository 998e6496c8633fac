"""What characterisation found as files: JSON and CSV, units in the names."""

from __future__ import annotations

import csv
import io
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final

from bench.plain import json_text
from bench.store.durable import replace_file

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from bench.analysis.results import Estimate
    from bench.characterize.result import Characterization, FamilyResult

__all__ = ["FORMAT", "save", "to_dict"]

FORMAT: Final = "evs-bench-characterization/1"

_LEVELS: Final = (
    "run", "polarity", "pulse_width_s", "settings", "baseline_lux", "nd_od", "half_ln", "half_low_ln", "half_high_ln",
    "intercept_ln", "intercept_low_ln", "intercept_high_ln", "theta_ln", "theta_low_ln", "theta_high_ln", "dark_lux",
    "dark_low_lux", "dark_high_lux", "noise_rms_ln", "photoreceptor_hz",
)  # fmt: skip


def to_dict(found: Characterization) -> dict[str, Any]:
    """Return all results but the maps as plain dictionaries and lists."""
    return {
        "format": FORMAT,
        "runs": list(found.runs),
        "interval": 0.9,
        "families": [_family(f) for f in found.families],
        "dark_light": None if found.dark is None else asdict(found.dark),
        "cutoffs": [asdict(c) for c in found.cutoffs],
        "noise": [asdict(n) for n in found.noise],
        "mismatch": [
            {
                "polarity": m.polarity,
                "sigma": asdict(m.sigma),
                "spread_of_map_ln": m.spread,
                "baseline_lux": m.baseline_lux,
            }
            for m in found.mismatch
        ],
        "hot_pixels": [asdict(s) for s in found.hot_pixels],
        "refractory_s": found.refractory_s,
        "uncertainties": asdict(found.beside),
        "warnings": list(found.warnings),
    }


def _family(family: FamilyResult) -> dict[str, Any]:
    plain = asdict(family)
    fit = family.fit
    plain["fit"] = None if fit is None else {
        "numbers": {name: asdict(fit.estimate(name, _UNITS[name])) for name in fit.free},
        "chi2": fit.chi2,
        "dof": fit.dof,
    }  # fmt: skip
    return plain


_UNITS: Final = {
    "theta": "ln", "noise_rms": "ln", "mismatch2": "ln2", "ln_tau": "ln(s)", "delay_s": "s", "dark_lux": "lux",
    "dark_spread2": "1", "shot_lux": "ln2 lux", "slow_s_lux": "s lux", "filter_od": "OD",
}  # fmt: skip


def save(found: Characterization, folder: Path) -> Path:
    """Write characterization.json, levels.csv and, of each mismatch, a map into `folder`; return the folder.

    Each file is whole or absent: it is written beside its place, then moved there.
    """
    import numpy as np

    folder.mkdir(parents=True, exist_ok=True)
    replace_file(folder / "characterization.json", json_text(to_dict(found)).encode())
    replace_file(folder / "levels.csv", _levels(found))
    for old in folder.glob("pixel_thresholds_*.npz"):
        old.unlink()  # of a characterisation before, of other runs perhaps
    for one in found.mismatch:
        buffer = io.BytesIO()
        np.savez_compressed(buffer, theta_ln=one.theta, error_ln=one.error)
        replace_file(folder / f"pixel_thresholds_{one.polarity}.npz", buffer.getvalue())
    return folder


def _levels(found: Characterization) -> bytes:
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_LEVELS)
    for family in found.families:
        for lv in family.levels:
            cells = [family.run, family.polarity, family.pulse_width_s, family.settings, lv.baseline_lux, lv.nd_od]
            cells += [*_three(lv.half), *_three(lv.intercept), *_three(lv.theta), *_three(lv.dark_lux)]
            writer.writerow(["" if c is None or c != c else c for c in [*cells, lv.noise_rms, lv.corner_hz]])
    return text.getvalue().encode()


def _three(estimate: Estimate | None) -> Sequence[float | None]:
    return (None, None, None) if estimate is None else (estimate.value, estimate.low, estimate.high)
