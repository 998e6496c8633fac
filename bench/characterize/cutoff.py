"""The low-light cutoff: the light at which half of the pixels answer a step of one contrast, usually of 100 %.

Measured from the shares of answers against the light; predicted from threshold and dark light: where the step just
changes the signal by the threshold, ``E = E_d (e^theta - 1) / (r - e^theta)``. Noise helps a step over the threshold,
so half of the pixels answer before that: what is compared with the measurement takes the 50 % point of the family of
curves for theta, what is said beside it the threshold itself.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.results import Estimate
from bench.characterize.normal import as_estimate, as_known
from bench.characterize.result import Cutoff
from bench.characterize.weber import weber
from bench.photometry.propagation import Known, propagate

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.analysis.results import ResponsePolarity, ResponseRow

    Floats = npt.NDArray[np.float64]

__all__ = ["cutoffs_in", "predicted_cutoff"]

_FEWEST: Final = 4  # light levels at one contrast
_SAME: Final = 1e-3  # of a log contrast
_SAMPLES: Final = 400
_ENOUGH: Final = 0.95  # of the samples must cross, too
_SEED: Final = 20240901


def predicted_cutoff(
    log_contrast: float, theta: Known, dark_lux: Known, polarity: ResponsePolarity = "on"
) -> Estimate | None:
    """Return the light at which a step of `log_contrast` just reaches the threshold, lux; None where none does."""

    def light(threshold: float, dark: float) -> float:
        least, step = weber(threshold, polarity), weber(log_contrast, polarity)
        return dark * least / (step - least)

    if weber(log_contrast, polarity) <= weber(theta.value + 3.0 * theta.sd, polarity):
        return None
    found = propagate(light, {"theta": theta, "dark light": dark_lux})
    return as_estimate(found.value, found.sd, "lux")


def cutoffs_in(
    rows: Sequence[ResponseRow],
    half: dict[tuple[ResponsePolarity, str], Known],
    theta: dict[tuple[ResponsePolarity, str], Known],
    dark_lux: Known | None,
) -> list[Cutoff]:
    """Return the cutoffs of contrasts that were taken at four light levels or more, and half answered between them.

    Parameters
    ----------
    half, theta
        50 % point far above the dark light, and threshold, of each polarity at each setting, as far as they are
        known.
    """
    groups: dict[tuple[ResponsePolarity, int, str, float], list[ResponseRow]] = {}
    for row in rows:
        if row.key.waveform == "reset_test":
            key = (row.key.polarity, round(row.log_contrast / _SAME), row.key.settings, row.key.pulse_width_s)
            groups.setdefault(key, []).append(row)
    found = []
    for (polarity, _, settings, _), own in groups.items():
        measured = _crossing(own) if len({r.key.baseline_lux for r in own}) >= _FEWEST else None
        if measured is None:
            continue
        contrast = own[0].log_contrast
        expected, quiet = (
            predicted_cutoff(contrast, known[polarity, settings], dark_lux, polarity)
            if dark_lux and (polarity, settings) in known
            else None
            for known in (half, theta)
        )
        found.append(Cutoff(polarity, contrast, measured, expected, quiet, _apart(measured, expected)))
    return found


def _apart(a: Estimate, b: Estimate | None) -> float:
    if b is None:
        return math.nan
    reach = math.hypot(as_known(a).sd, as_known(b).sd)
    return (a.value - b.value) / reach if reach > 0.0 else math.nan


def _crossing(rows: Sequence[ResponseRow]) -> Estimate | None:
    """Return where the share of answers crosses a half, by straight lines against the logarithm of the light."""
    if len({r.per_pixel.size for r in rows}) > 1:
        return None
    rows = sorted(rows, key=lambda r: r.key.baseline_lux)
    ln_lux = np.log([r.key.baseline_lux for r in rows])
    share = np.stack([r.per_pixel / r.pulses for r in rows])
    alive = share.max(axis=0) > 0.0
    if not alive.any():
        return None
    share = share[:, alive]
    rng = np.random.default_rng(_SEED)
    drawn = rng.multinomial(alive.sum(), np.full(int(alive.sum()), 1.0 / alive.sum()), size=_SAMPLES) / alive.sum()
    here = _half(ln_lux, share.mean(axis=1))
    if here is None:
        return None
    samples = [s for s in (_half(ln_lux, share @ weights) for weights in drawn) if s is not None]
    if len(samples) < _ENOUGH * _SAMPLES:
        return None  # too near the end of the levels
    low, high = np.exp(np.percentile(samples, [5.0, 95.0]))
    return Estimate(math.exp(here), float(low), float(high), "lux")


def _half(ln_lux: Floats, share: Floats) -> float | None:
    rising = np.maximum.accumulate(share)
    if rising[0] >= 0.5 or rising[-1] <= 0.5:
        return None
    i = int(np.argmax(rising > 0.5))
    part = (0.5 - rising[i - 1]) / (rising[i] - rising[i - 1])
    return float(ln_lux[i - 1] + part * (ln_lux[i] - ln_lux[i - 1]))
