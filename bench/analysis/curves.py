"""S-curves of a run: entries sorted into curves, fitted, and marked where they show another threshold."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.grouping import curve_counts
from bench.analysis.pixel_map import pixel_map
from bench.analysis.results import SCurve
from bench.analysis.scurve import INTERCEPT_LEVEL, fit_curve
from bench.analysis.square_wave import less_sensitive

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bench.analysis.grouping import Entry
    from bench.analysis.noisy_pixel import ThetaFit
    from bench.analysis.results import CurveKey, PixelMap, ResponsePolarity, ResponseRow
    from bench.analysis.scurve import CurveFit

    ThetaFitter = Callable[[Sequence[ResponseRow]], ThetaFit | None]

__all__ = ["REARMED_ENOUGH", "make_curves"]

REARMED_ENOUGH: Final = 0.95
_LOW_PLATEAU: Final = 0.95
_HIGH_FLOOR: Final = 0.02
_OTHER: Final[dict[ResponsePolarity, ResponsePolarity]] = {"on": "off", "off": "on"}


def make_curves(
    entries: Sequence[Entry],
    rows: Sequence[ResponseRow],
    theta_fit: ThetaFitter | None,
    *,
    pixel_maps: bool,
    progress: Callable[[int, int], None],
) -> tuple[tuple[SCurve, ...], tuple[PixelMap, ...]]:
    """Return the S-curves of a run in the order of level, width and polarity, and the maps of single pixels.

    Parameters
    ----------
    entries, rows
        One of each for every group of test pulses, in the same order.
    theta_fit
        Reads the threshold of a noisy pixel off the rows of a curve; None leaves it out.
    """
    members: dict[CurveKey, list[int]] = {}
    for i, row in enumerate(rows):
        members.setdefault(row.key, []).append(i)
    limits = _limits({key: [entries[i] for i in mine] for key, mine in members.items()})
    curves: list[SCurve] = []
    maps: list[PixelMap] = []
    for done, key in enumerate(sorted(members, key=_order)):
        progress(done, len(members))
        mine = [entries[i] for i in members[key]]
        counts = curve_counts(mine)
        fit = fit_curve(counts)
        my_rows = sorted((rows[i] for i in members[key]), key=lambda r: r.log_contrast)
        theta = theta_fit(my_rows) if theta_fit is not None and np.isfinite(fit.half.value) else None
        curves.append(_curve(key, counts.log_contrast, fit, my_rows, theta, limits.get(key, (None, ""))))
        if pixel_maps and np.isfinite(fit.half.value):
            maps.append(pixel_map(key, counts, float(np.nan_to_num(fit.floor.value)), fit.plateau.value, mine[0].roi))
    progress(len(members), len(members))
    return tuple(curves), tuple(maps)


def _order(key: CurveKey) -> tuple[str, str, float, float, float, str]:
    return key.settings, key.waveform, key.pulse_width_s, key.baseline_lux, key.nd_od, key.polarity


def _curve(
    key: CurveKey,
    log_contrast: np.ndarray[tuple[int], np.dtype[np.float64]],
    fit: CurveFit,
    rows: Sequence[ResponseRow],
    theta: ThetaFit | None,
    limit: tuple[ResponsePolarity | None, str],
) -> SCurve:
    shares = [row.answered_resets for row in rows]
    answered = float(np.nanmin(shares)) if np.any(np.isfinite(shares)) else float("nan")
    return SCurve(
        key=key,
        log_contrast=log_contrast,
        probability=fit.probability,
        low=fit.low,
        high=fit.high,
        half=fit.half,
        intercept=fit.intercept,
        floor=fit.floor,
        plateau=fit.plateau,
        quantile=INTERCEPT_LEVEL,
        theta=theta.theta if theta is not None else None,
        noise_rms=theta.noise_rms if theta is not None else None,
        fit_contrast=fit.fit_contrast,
        fit_probability=fit.fit_probability,
        answered_resets=answered,
        limited_by=limit[0],
        warnings=(*fit.warnings, *_warnings(fit, rows), *([limit[1]] if limit[1] else [])),
        theta_99=theta.theta_99 if theta is not None else None,
        mismatch=theta.mismatch if theta is not None else None,
        corner_hz=theta.corner_hz if theta is not None else None,
    )


def _warnings(fit: CurveFit, rows: Sequence[ResponseRow]) -> list[str]:
    found = []
    bad = [row.point for row in rows if row.answered_resets < REARMED_ENOUGH]
    if bad:
        share = min(row.answered_resets for row in rows if row.point in bad)
        found.append(
            f"fewer than {REARMED_ENOUGH:.0%} of the resets were answered (down to {share:.0%}): pixels that were "
            f"not re-armed count as silent; points {_numbers(bad)}"
        )
    if fit.plateau.high < _LOW_PLATEAU:
        found.append(
            f"the plateau is {fit.plateau.value:.3f}: at high contrast {1 - fit.plateau.value:.1%} of the test "
            "pulses stay without an answer"
        )
    if fit.floor.low > _HIGH_FLOOR:
        found.append(
            f"the floor is {fit.floor.value:.3f}: so many windows hold an event of the background, not an answer"
        )
    return found


def _numbers(points: Sequence[int], most: int = 12) -> str:
    shown = ", ".join(str(p) for p in sorted(points)[:most])
    return shown if len(points) <= most else f"{shown} and {len(points) - most} more"


def _limits(members: dict[CurveKey, list[Entry]]) -> dict[CurveKey, tuple[ResponsePolarity | None, str]]:
    """Return for each curve of a square wave whose threshold it shows instead of its own, with a warning.

    Thresholds are a matter of the settings: where one curve does not tell, all of the same settings are asked.
    """
    pairs = _square_pairs(members)
    limits: dict[CurveKey, tuple[ResponsePolarity | None, str]] = {}
    for on, off in pairs:
        larger = less_sensitive(members[on], members[off])
        if larger is None:
            alike = [p for p in pairs if p[0].settings == on.settings and _same_pixels(members, p[0], on)]
            larger = less_sensitive(
                [e for p in alike for e in members[p[0]]], [e for p in alike for e in members[p[1]]]
            )
        limits[on], limits[off] = _limit("on", larger), _limit("off", larger)
    return limits


def _square_pairs(members: dict[CurveKey, list[Entry]]) -> list[tuple[CurveKey, CurveKey]]:
    """Return the ON and OFF curves that come from the same square waves."""
    points = {key: {e.point for e in entries} for key, entries in members.items() if key.waveform == "square"}
    return [
        (on, off)
        for on in points
        for off in points
        if on.polarity != "off" == off.polarity and points[on] & points[off]
    ]


def _same_pixels(members: dict[CurveKey, list[Entry]], a: CurveKey, b: CurveKey) -> bool:
    return members[a][0].roi == members[b][0].roi


def _limit(
    mine: ResponsePolarity, less_sensitive_one: ResponsePolarity | None
) -> tuple[ResponsePolarity | None, str]:
    if less_sensitive_one == mine:
        return None, ""
    other = _OTHER[mine]
    if less_sensitive_one is None:
        return other, "a square wave shows only the larger threshold; which of the two it is, these data do not tell"
    return other, f"a square wave shows only the larger threshold: this is that of {other.upper()}, not its own"
