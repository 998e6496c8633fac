"""The numbers of a characterization as the report shows them: a list of headlines, and tables."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from bench.report.figures.mismatch import sigma_text
from bench.report.results_table import Cell, Table
from bench.report.wording import MISSING, count, interval_text, lux_interval, lux_label, polarity_label

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from bench.analysis.results import Estimate
    from bench.report.characterized import SavedCharacterization, SavedFamily, SavedLevel

__all__ = ["Headline", "family_table", "headlines", "level_table"]

_MOST_SPOTS: Final = 5
_SUPERSCRIPT: Final = str.maketrans(
    "-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079"
)


@dataclass(frozen=True, slots=True)
class Headline:
    """One number of the sensor: its name, and its value with what belongs to it."""

    name: str
    value: str
    about: str = ""  #: in small letters


def headlines(found: SavedCharacterization) -> tuple[Headline, ...]:
    """Return the numbers of the sensor, most important first."""
    return (*_dark(found.dark), *_thresholds(found), *_others(found))


def _dark(dark: Mapping[str, Any] | None) -> Iterator[Headline]:
    if dark is None:
        yield Headline("Equivalent dark illuminance", "not known", "no family of curves tells it")
        return
    scale, unit = (1e3, "mlux") if abs(dark["lux"].value) < 1.0 else (1.0, "lux")
    yield Headline("Equivalent dark illuminance", lux_interval(dark["lux"]), _parts(dark["parts"], scale, unit))
    current, diode = dark["current_fa"], dark["photodiode"]
    if current is None or diode is None:
        yield Headline("Dark current", "not known", "the run does not tell quantum efficiency or pitch")
        return
    text, interval = interval_text(current)
    photons = _power(diode["photons_per_lux"]["value"])
    yield Headline(
        "Dark current",
        f"{text} fA ({interval})",
        f"with quantum efficiency {_known(diode['eta'])}, pitch {1e6 * diode['pitch_m']['value']:.3g} \u00b5m, "
        f"{photons} photons per lux, m\u00b2 and s; {_parts(dark['current_parts'], 1.0, 'fA')}",
    )


def _parts(parts: Mapping[str, float], scale: float, unit: str) -> str:
    shown = [f"{name} {abs(value) * scale:.2g}" for name, value in parts.items() if value]
    return f"standard error from {', '.join(shown)} {unit}" if shown else "no standard error is known"


def _known(plain: Mapping[str, float]) -> str:
    return f"{plain['value']:g} \u00b1 {plain['sd']:g}" if plain["sd"] else f"{plain['value']:g} (taken as exact)"


def _power(value: float) -> str:
    """Return a large number as people write it: ``1.12 x 10^16``."""
    mantissa, _, power = f"{value:.3g}".partition("e")
    return f"{mantissa}\u00b710{str(int(power)).translate(_SUPERSCRIPT)}" if power else mantissa


def _thresholds(found: SavedCharacterization) -> Iterator[Headline]:
    """Yield the threshold of each polarity, from the family that knows it best."""
    for polarity in ("on", "off"):
        mine = [f for f in found.families if f.polarity == polarity and math.isfinite(f.theta.value)]
        if mine:
            best = min(mine, key=lambda f: f.theta.high - f.theta.low)
            text, interval = interval_text(best.theta)
            source = "fit of one noisy pixel to all levels" if best.fit else "straight line through the readings"
            yield Headline(
                f"{polarity_label(polarity)} threshold", f"{text} ln ({interval})", f"{source}, {best.kind}"
            )


def _others(found: SavedCharacterization) -> Iterator[Headline]:
    for one in found.mismatch:
        yield Headline(f"{polarity_label(one.polarity)} mismatch", f"{sigma_text(one.sigma)}, ln units")
    for cutoff in found.cutoffs:
        predicted = cutoff["predicted_lux"]
        about = (
            "nothing to compare with: no threshold and dark light"
            if predicted is None
            else f"threshold and dark light let expect {lux_interval(predicted)}"
        )
        step = 100.0 * math.expm1(cutoff["log_contrast"])
        name = f"{polarity_label(cutoff['polarity'])} low-light cutoff, step of {step:.0f} %"
        yield Headline(name, lux_interval(cutoff["measured_lux"]), about)
    if found.hot_pixels:
        spots = [f"({s['x']}, {s['y']}) {s['rate_hz']:.3g} Hz" for s in found.hot_pixels[:_MOST_SPOTS]]
        more = len(found.hot_pixels) - len(spots)
        text = ", ".join(spots) + (f" and {more} more" if more else "")
        yield Headline("Hot pixels", count(len(found.hot_pixels), "pixel"), text)


def family_table(families: Sequence[SavedFamily]) -> Table | None:
    """Return what each family tells; None without families."""
    if not families:
        return None
    heads = (
        ("polarity", ""), ("family", ""), ("threshold", "ln"), ("dark light", "lux"),
        ("one threshold", "p"), ("low-pass", "Hz"), ("filter denser by", "OD"), ("chi-square", "per dof"),
    )  # fmt: skip
    return _without_empty(heads, [_family_cells(f) for f in families], 2)


def _family_cells(family: SavedFamily) -> tuple[Cell, ...]:
    p = MISSING if family.test is None else f"{family.test.p_value:.2g}"
    return (
        Cell(polarity_label(family.polarity), polarity=family.polarity),
        Cell(family.kind, "" if family.fit else "no fit"),
        _cell(family.theta),
        _cell(family.dark_lux),
        Cell(p, "" if family.test is None else ("holds" if family.test.holds else "changes with light")),
        _low_pass(family),
        _cell(family.filter_od),
        Cell(MISSING if math.isnan(family.chi2_per_dof) else f"{family.chi2_per_dof:.2f}"),
    )


def _low_pass(family: SavedFamily) -> Cell:
    tau = family.fit.get("ln_tau")
    if tau is None:
        return Cell(MISSING)
    value, low, high = (1.0 / (2.0 * math.pi * math.exp(t)) for t in (tau.value, tau.high, tau.low))
    return Cell(f"{value:.3g}", f"{low:.3g} to {high:.3g}")


def level_table(family: SavedFamily) -> Table:
    """Return what each level of a family tells."""
    heads = (
        ("light on chip", ""), ("filter", ""), ("50 % point", "ln"), ("intercept", "ln"),
        ("threshold", "ln, dark light accounted for"), ("dark light by this level", ""), ("noise", "ln, rms"),
        ("photoreceptor", "Hz"),
    )  # fmt: skip
    return _without_empty(heads, [_level_cells(lv) for lv in family.levels], 1)


def _level_cells(level: SavedLevel) -> tuple[Cell, ...]:
    text, _, interval = lux_interval(level.dark_lux).partition(" (")
    return (
        Cell(lux_label(level.baseline_lux)),
        Cell(f"OD {level.nd_od:g}" if level.nd_od else MISSING),
        _cell(level.half),
        _cell(level.intercept),
        _cell(level.theta),
        Cell(text, interval.removesuffix(")")),
        Cell(f"{level.noise_rms:.4f}" if math.isfinite(level.noise_rms) else MISSING),
        Cell(f"{level.corner_hz:.3g}" if math.isfinite(level.corner_hz) else MISSING),
    )


def _cell(estimate: Estimate | None) -> Cell:
    return Cell(MISSING) if estimate is None else Cell(*interval_text(estimate))


def _without_empty(heads: Sequence[tuple[str, str]], rows: Sequence[tuple[Cell, ...]], left: int) -> Table:
    """Return a table without the columns that say nothing in any row."""
    kept = [i for i in range(len(heads)) if i < left or any(row[i].text != MISSING for row in rows)]
    return Table(tuple(heads[i] for i in kept), tuple(tuple(row[i] for i in kept) for row in rows), left)
