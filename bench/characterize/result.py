"""What characterisation finds: plain frozen dataclasses, numbers only. Intervals are 90 % intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from bench.analysis.results import Estimate, ResponsePolarity
    from bench.characterize.family_fit import FamilyFit
    from bench.characterize.readings import Line, Uncertainties
    from bench.photometry.current import Photodiode

__all__ = [
    "Characterization",
    "Constancy",
    "Cutoff",
    "DarkLight",
    "FamilyResult",
    "FilterBreak",
    "LevelResult",
    "Mismatch",
    "NoiseLevel",
    "Spot",
]


@dataclass(frozen=True, slots=True)
class LevelResult:
    """One light level of a family."""

    baseline_lux: float
    nd_od: float
    half: Estimate  #: 50 % point of the curve, log contrast
    intercept: Estimate  #: its intercept, log contrast
    theta: Estimate | None  #: threshold that this level tells with dark light accounted for, ln; None without a fit
    dark_lux: Estimate  #: from the intercept of this level and the threshold of the line through all intercepts
    parts: dict[str, float]  #: what each number adds to the standard error of that, lux
    noise_rms: float  #: at the comparators at this level, ln; NaN without a fit
    corner_hz: float  #: of the photoreceptor at the baseline of this level; infinite: not seen, NaN without a fit


@dataclass(frozen=True, slots=True)
class Constancy:
    """Whether one threshold holds at all levels, once dark light is accounted for."""

    chi2: float
    dof: int
    p_value: float
    largest: float  #: the largest deviation of a level from the threshold, ln

    @property
    def holds(self) -> bool:
        """Whether the data agree with one threshold, at 1 %."""
        return self.p_value > 0.01


@dataclass(frozen=True, slots=True)
class FilterBreak:
    """An error of the filters' optical density that shows as a break between levels with and without one."""

    delta_od: Estimate  #: denser by this than the nominal value

    @property
    def seen(self) -> bool:
        """Whether it is there beyond chance: outside of a 90 % interval twice as wide."""
        reach = self.delta_od.high - self.delta_od.value
        return abs(self.delta_od.value) > 2.0 * reach


@dataclass(frozen=True, slots=True)
class FamilyResult:
    """What one family of S-curves tells."""

    run: str  #: id
    polarity: ResponsePolarity
    waveform: str
    pulse_width_s: float
    settings: str
    levels: tuple[LevelResult, ...]
    by_intercept: Line | None  #: straight line through the intercepts, as papers do it
    by_half: Line | None  #: through the 50 % points
    fit: FamilyFit | None
    why_no_fit: str
    constant: Constancy | None
    filter_break: FilterBreak | None
    theta: Estimate  #: the best that there is: of the fit, else of the line through the intercepts
    dark_lux: Estimate  #: likewise; only what chance does
    biased: float  #: by which part the line through the intercepts misses the fit's dark light; NaN without a fit
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class DarkLight:
    """The equivalent dark illuminance, of all families together."""

    lux: Estimate
    parts: dict[str, float]  #: standard error from chance, light, contrast, filter; lux
    current_fa: Estimate | None  #: None where efficiency or pitch are not known
    current_parts: dict[str, float]  #: fA
    photodiode: Photodiode | None
    scatter: float  #: chi-square per degree of freedom of the families about their mean; NaN for a single one


@dataclass(frozen=True, slots=True)
class Cutoff:
    """The light at which half of the pixels answer a step of one contrast."""

    polarity: ResponsePolarity
    log_contrast: float
    measured_lux: Estimate
    predicted_lux: Estimate | None  #: from the 50 % point in bright light and the dark light; None without them
    quiet_lux: Estimate | None  #: from the threshold and the dark light: of a pixel without noise
    sigma: float  #: by how many standard errors the two differ


@dataclass(frozen=True, slots=True)
class NoiseLevel:
    """Background activity in one constant light."""

    baseline_lux: float
    nd_od: float
    settings: str
    on: Estimate  #: Hz per pixel
    off: Estimate
    random_hz: float  #: of both polarities together, without the regular part
    leak_per_s: Estimate | None  #: regular part: more ON than OFF events, as a drift of the signal, ln/s
    noise_rms: float  #: that gives the random part; NaN where it cannot be told
    corner_hz: float  #: the bandwidth that this assumes


@dataclass(frozen=True, slots=True)
class Mismatch:
    """How thresholds differ from pixel to pixel, of one polarity."""

    polarity: ResponsePolarity
    sigma: Estimate  #: of the fit, ln; the counting noise of the pixels is not in it
    theta: npt.NDArray[np.float64] = field(repr=False)  #: (height, width) each pixel's own, ln; NaN where unknown
    error: npt.NDArray[np.float64] = field(repr=False)  #: (height, width) standard error of each
    baseline_lux: float  #: of the curve that the map is from
    spread: float  #: of the map, corrected for its counting errors, ln


@dataclass(frozen=True, slots=True)
class Spot:
    """A hot pixel: far more events in constant light than the others."""

    x: int
    y: int
    rate_hz: float
    usual_hz: float


@dataclass(frozen=True, slots=True)
class Characterization:
    """The numbers of a sensor."""

    runs: tuple[str, ...]
    families: tuple[FamilyResult, ...]
    dark: DarkLight | None
    cutoffs: tuple[Cutoff, ...]
    noise: tuple[NoiseLevel, ...]
    mismatch: tuple[Mismatch, ...]
    hot_pixels: tuple[Spot, ...]
    refractory_s: float  #: that the settings are believed to give; NaN where unknown
    beside: Uncertainties
    warnings: tuple[str, ...] = ()

    def theta(self, polarity: ResponsePolarity) -> Estimate | None:
        """Return the threshold of a polarity from the family that knows it best; None if there is none.

        Of several settings, that of the family that knows its threshold best of all.
        """
        known = sorted(
            (f for f in self.families if math.isfinite(f.theta.value)), key=lambda f: f.theta.high - f.theta.low
        )
        mine = [f.theta for f in known if f.polarity == polarity and f.settings == known[0].settings]
        return mine[0] if mine else None
