"""What characterisation found, in lines for a terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from bench.report.wording import duration_label, lux_label

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from bench.analysis.results import Estimate
    from bench.characterize.result import Characterization, Cutoff, DarkLight, FamilyResult, NoiseLevel
    from bench.photometry.propagation import Known

__all__ = ["summary_lines"]

_BIASED: Final = 0.05  # by which part readings must miss the fit to be worth a word


def summary_lines(found: Characterization) -> list[str]:
    """Return all results as lines of text."""
    lines = [f"{', '.join(found.runs)}: 90 % intervals; contrasts and thresholds in ln units"]
    for family in found.families:
        lines += ["", *_family(family)]
    if found.dark is not None:
        lines += ["", *_dark(found.dark)]
    for cutoff in found.cutoffs:
        lines += ["", *_cutoff(cutoff)]
    if found.noise:
        lines += ["", "Background activity, per pixel", *_noise(found.noise)]
    for one in found.mismatch:
        text = (
            _value(one.sigma, 4)
            if one.sigma.value > 0.0 and not one.sigma.note
            else f"none seen, below {one.sigma.high:.4f}"
        )
        lines += ["", f"Mismatch of the {one.polarity.upper()} thresholds over the pixels: {text}"]
    if found.hot_pixels:
        lines += ["", f"Hot pixels: {_some([f'({s.x}, {s.y}) {s.rate_hz:.3g} Hz' for s in found.hot_pixels])}"]
    if found.warnings:
        lines += ["", "Warnings", *[f"  {text}" for text in found.warnings]]
    return lines


def _family(family: FamilyResult) -> Iterator[str]:
    kind = "reset and test pulses" if family.waveform == "reset_test" else "square wave"
    width = f" of {duration_label(family.pulse_width_s)}" if math.isfinite(family.pulse_width_s) else ""
    settings = f", {family.settings}" if family.settings else ""
    yield f"{family.polarity.upper()} thresholds: {kind}{width}{settings}"
    yield from _table(
        ("level", "filter", "50 %", "100 %", "threshold", "dark light by this level", "noise", "photoreceptor"),
        [
            (
                lux_label(lv.baseline_lux),
                f"OD {lv.nd_od:g}" if lv.nd_od else "-",
                _value(lv.half, 3),
                _value(lv.intercept, 3),
                "-" if lv.theta is None else _value(lv.theta, 4),
                _lux(lv.dark_lux),
                _plain(lv.noise_rms, "{:.4f}"),
                "fast" if math.isinf(lv.corner_hz) else _plain(lv.corner_hz, "{:.3g} Hz"),
            )
            for lv in family.levels
        ],
    )
    yield f"  threshold  {_value(family.theta, 4)}, {_source(family)}"
    if family.by_intercept is not None and family.fit is not None:
        line = family.by_intercept
        yield f"  by intercepts {_value(line.theta, 3)}, dark light {_lux(line.dark_lux)}"
    if family.constant is not None:
        verdict = (
            "one threshold holds at all levels once dark light is accounted for"
            if family.constant.holds
            else "the threshold changes with the light, dark light accounted for"
        )
        test = family.constant
        yield f"  {verdict} (chi-square {test.chi2:.1f} for {test.dof}, p = {test.p_value:.2g})"
    if family.filter_break is not None:
        od = family.filter_break.delta_od
        seen = "a break between levels with and without filter" if family.filter_break.seen else "no break"
        yield f"  filter: {seen}; denser than stated by OD {_value(od, 3)}"
    yield from _bandwidth(family)


def _source(family: FamilyResult) -> str:
    if family.fit is not None:
        return f"fit of one noisy pixel to all levels (chi-square {family.fit.chi2:.0f} for {family.fit.dof})"
    return f"straight line through the readings; no fit: {family.why_no_fit}"


def _bandwidth(family: FamilyResult) -> Iterator[str]:
    fit = family.fit
    if fit is None:
        return
    ln_tau = fit.estimate("ln_tau", "ln s")
    corner, low, high = (math.exp(-value) / (2.0 * math.pi) for value in (ln_tau.value, ln_tau.high, ln_tau.low))
    yield f"  bandwidth: low-pass {corner:.3g} [{low:.3g}, {high:.3g}] Hz at every light"
    if fit.sees_slow:
        per_lux = 1.0 / (2.0 * math.pi * fit.family.slow_s_lux)
        yield f"  photoreceptor: {per_lux:.3g} Hz per lux of light and dark light; it follows the light"
    if math.isfinite(family.biased) and abs(family.biased) > _BIASED:
        cause = "for want of bandwidth" if fit.sees_slow else "by noise and reading"
        yield f"  the readings alone would give {family.biased:+.0%} dark light, {cause}; the fit corrects for it"


def _dark(dark: DarkLight) -> Iterator[str]:
    yield f"Equivalent dark illuminance {_lux(dark.lux)}"
    yield f"  standard error: {_parts(dark.parts, 1e3, 'mlux')}"
    if not math.isnan(dark.scatter):
        yield f"  families scatter about their mean by chi-square {dark.scatter:.1f} per degree of freedom"
    if dark.current_fa is None or dark.photodiode is None:
        yield "  no current: the run does not tell quantum efficiency or pitch"
        return
    diode = dark.photodiode
    yield (
        f"Dark current {_value(dark.current_fa, 3)} fA = E_d eta N q p^2, with eta {_known(diode.eta)}, pitch "
        f"{diode.pitch_m.value * 1e6:.3g} um, N {diode.photons_per_lux.value:.3g} photons per lux, m2 and s"
    )
    yield f"  standard error: {_parts(dark.current_parts, 1.0, 'fA')}"


def _cutoff(cutoff: Cutoff) -> Iterator[str]:
    step = f"{100.0 * math.expm1(cutoff.log_contrast):.0f} %"
    light = _lux(cutoff.measured_lux)
    yield f"Low-light cutoff, {cutoff.polarity.upper()}: half of the pixels answer a step of {step} at {light}"
    if cutoff.predicted_lux is None:
        yield "  nothing to compare with: no threshold and dark light"
    else:
        apart = f"apart by {abs(cutoff.sigma):.1f} standard errors"
        yield f"  from the 50 % point in bright light and the dark light {_lux(cutoff.predicted_lux)}; {apart}"
    if cutoff.quiet_lux is not None:
        yield f"  a pixel of this threshold without noise would answer from {_lux(cutoff.quiet_lux)} on"


def _noise(levels: Sequence[NoiseLevel]) -> Iterator[str]:
    yield from _table(
        ("level", "ON", "OFF", "random", "leak", "noise", "at a corner of"),
        [
            (
                lux_label(n.baseline_lux),
                f"{_value(n.on, 4)} Hz",
                f"{_value(n.off, 4)} Hz",
                f"{n.random_hz:.3g} Hz",
                "-" if n.leak_per_s is None else f"{_value(n.leak_per_s, 4)} /s",
                _plain(n.noise_rms, "{:.4f}"),
                _plain(n.corner_hz, "{:.3g} Hz"),
            )
            for n in levels
        ],
    )


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield aligned columns; one that is empty throughout is left out."""
    columns = [list(column) for column in zip(header, *rows, strict=True)]
    columns = [c for c in columns if any(cell != "-" for cell in c[1:])]
    widths = [max(len(cell) for cell in c) for c in columns]
    for row in zip(*columns, strict=True):
        yield "  " + "  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip()


def _value(estimate: Estimate, decimals: int) -> str:
    if not math.isfinite(estimate.value):
        return "-"
    return f"{estimate.value:.{decimals}f} [{estimate.low:.{decimals}f}, {estimate.high:.{decimals}f}]"


def _lux(estimate: Estimate) -> str:
    if not math.isfinite(estimate.value):
        return "-"
    factor, unit = (1e3, "mlux") if max(abs(estimate.value), abs(estimate.high)) < 1.0 else (1.0, "lux")
    return f"{estimate.value * factor:.4g} [{estimate.low * factor:.4g}, {estimate.high * factor:.4g}] {unit}"


def _plain(value: float, form: str) -> str:
    return form.format(value) if math.isfinite(value) else "-"


def _known(known: Known) -> str:
    return f"{known.value:g} +- {known.sd:g}" if known.sd else f"{known.value:g} (taken as exact)"


def _parts(parts: dict[str, float], factor: float, unit: str) -> str:
    shown = [f"{name} {abs(v) * factor:.3g}" for name, v in parts.items() if v]
    return f"{', '.join(shown)} {unit}" if shown else "none"


def _some(texts: Sequence[str], most: int = 8) -> str:
    return ", ".join(texts[:most]) + (f" and {len(texts) - most} more" if len(texts) > most else "")
