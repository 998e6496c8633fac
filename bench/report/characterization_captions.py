"""What stands below each figure of a characterization: what it shows, and what to look at."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bench.report.figures.mismatch import sigma_text
from bench.report.wording import polarity_label

if TYPE_CHECKING:
    from bench.report.figures.bandwidth import BandwidthNumbers, Corners
    from bench.report.figures.level_thresholds import LevelThresholdNumbers
    from bench.report.figures.mismatch import MismatchNumbers
    from bench.report.figures.noise_light import NoiseLightNumbers
    from bench.report.figures.weber import WeberNumbers

__all__ = ["bandwidth", "level_thresholds", "mismatch", "noise_light", "weber"]


def weber(numbers: WeberNumbers) -> str:
    """Caption of the straight lines."""
    fitted = any(line.name == "fit" for panel in numbers.panels for line in panel.lines)
    between = (
        " The solid line is the fit of one noisy pixel to all curves: it has the threshold itself, from which the "
        "readings are off by noise and bandwidth."
        if fitted
        else ""
    )
    return (
        "The step that each level needs, as a part of that level, against 1/E, with 90 % intervals. Behind one "
        f"threshold this is a straight line, W = w (1 + E_d/E).{between} The diamond marks where the best line meets "
        "0, at 1/E = \u22121/E_d, and the bar on it the 90 % interval of the dark light E_d. Light levels are the "
        "stated ones: points behind a filter (open) that lie off the line by themselves show a wrong density."
    )


def level_thresholds(numbers: LevelThresholdNumbers) -> str:
    """Caption of the thresholds of the levels."""
    fitted = any(panel.fitted for panel in numbers.panels)
    how = (
        "each level by itself, all else as fitted to all levels"
        if fitted
        else "the reading of each level, less what the dark light of the straight line does to it"
    )
    return (
        f"Diamonds: the threshold at each light level with dark light accounted for ({how}); pale squares: the "
        "apparent one, which rises in the dark. Below, the diamonds enlarged. Bars and the band of the common "
        "threshold are 90 % intervals. The band holds what is uncertain for all levels alike; p is the chance of "
        "levels that differ as much where one threshold holds."
    )


def noise_light(numbers: NoiseLightNumbers) -> str:
    """Caption of background activity against light."""
    text = (
        "Above, events per pixel and second at constant light, with 90 % intervals; the dashed line is the random "
        "part, ON and OFF together without the surplus of ON events, which is a leak."
    )
    if not numbers.noise:
        return f"{text} No fit tells threshold and bandwidth, so that no noise can be told from the rates."
    text += " Below, the noise at the comparators."
    if math.isfinite(numbers.corner_hz):
        text += (
            f" From the background it is told for a low-pass with a corner of {numbers.corner_hz:.3g} Hz; half the "
            "bandwidth makes half the events."
        )
    return f"{text} Where it and that of the fit differ, one low-pass is not all that there is."


def bandwidth(numbers: BandwidthNumbers) -> str:
    """Caption of the corners."""
    slopes = " ".join(_slope(c) for c in numbers.corners)
    return (
        "The corner of the photoreceptor, which follows all the light, dark light included, and that of the low-pass "
        f"behind it. Where the first is lower, the photoreceptor limits the pixel. {slopes} The line bends towards "
        "the left where dark light is most of the light."
    )


def _slope(corners: Corners) -> str:
    value, low, high = corners.hz_per_lux
    return f"{polarity_label(corners.polarity)}: {value:.3g} Hz per lux (90 % interval {low:.3g} to {high:.3g})."


def mismatch(numbers: MismatchNumbers) -> str:
    """Caption of the thresholds of the pixels."""
    values = "; ".join(f"{polarity_label(m.polarity)} {sigma_text(m.sigma)}" for m in numbers.maps)
    return (
        "The threshold of each pixel, from its curve at the brightest level: its 50 % point, moved by what noise "
        "does to that of all; grey pixels have none. Counting few pulses widens the histogram; the mismatch, in ln "
        f"units, is without that: {values}. It is of the fit to all curves where there is one, which knows of pixels "
        "that are grey here, too."
    )
