"""What stands below each figure: what it shows, and what to look at."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bench.report.figures.resets import ENOUGH_RESETS
from bench.report.wording import capital, count, fixed, lux_label, polarity_label, waveform_label

if TYPE_CHECKING:
    from bench.report.example import Example
    from bench.report.families import Axis, Family
    from bench.report.figures.background import BackgroundNumbers
    from bench.report.figures.error_fall import ErrorFallNumbers
    from bench.report.figures.event_map import EventMapNumbers
    from bench.report.figures.latency import LatencyNumbers
    from bench.report.figures.measured_predicted import MeasuredPredictedNumbers
    from bench.report.figures.misfit_map import MisfitMapNumbers
    from bench.report.figures.pixel import PixelNumbers
    from bench.report.figures.pixel_maps import PixelMapNumbers, Spread
    from bench.report.figures.ranking import RankingNumbers
    from bench.report.figures.resets import ResetNumbers
    from bench.report.figures.residual_axes import ResidualAxesNumbers
    from bench.report.figures.scurves import SCurveNumbers
    from bench.report.figures.thresholds import ThresholdNumbers

__all__ = [
    "background",
    "error_fall",
    "event_map",
    "latency",
    "measured_predicted",
    "misfit_map",
    "pixel",
    "pixel_maps",
    "ranking",
    "resets",
    "residual_axes",
    "scurves",
    "thresholds",
]

_COLOURS: dict[Axis, str] = {
    "level": "Each colour is one light level on chip, dark for little light.",
    "width": "Each colour is one length of the test pulse, dark for short.",
    "settings": "Each colour is one setting of the sensor.",
}


def scurves(numbers: SCurveNumbers, family: Family) -> str:
    """Caption of the family of S-curves."""
    theta = ", diamonds the fitted threshold" if numbers.has_theta else ""
    return (
        f"{capital(family.title)}. The share of test pulses that were answered, against their contrast. Bars are "
        f"90 % intervals, lines the fits; open circles mark the 50 % point, open squares the intercept{theta}; the "
        f"lower panels show them with their intervals.{_look(family)}"
    )


def _look(family: Family) -> str:
    """Return what the colours are, and what curves beside each other say; nothing where there is only one colour."""
    if len(family.steps) == 1:
        return ""
    shift = {
        "level": "Curves that move to the right as the light falls show light that is not modulated: dark current or "
        "stray light, or a pixel too slow for the pulse.",
        "width": "Curves that move to the right as the pulse gets shorter show a pixel too slow for the pulse.",
        "settings": "What moves from curve to curve is what the setting does.",
    }[family.axis]
    return f" {_COLOURS[family.axis]} {shift}"


def thresholds(numbers: ThresholdNumbers, family: Family) -> str:
    """Caption of the threshold figure."""
    against = {"level": "light level", "width": "length of the test pulse", "settings": "setting"}[family.axis]
    theta = any(series.reading == "theta" for series in numbers.series)
    best = (
        " The fitted threshold is the one to compare with a truth; the other two shift with noise." if theta else ""
    )
    return (
        f"{capital(family.title)}. What was read off each S-curve, against the {against}; bars are 90 % "
        f"intervals.{best} Readings at the same place are drawn side by side."
    )


def background(numbers: BackgroundNumbers) -> str:
    """Caption of the background rates."""
    arrows = any(bool(rates.limit.any()) for rates in numbers.rates)
    limits = " Arrows are upper limits: not one event was seen." if arrows else ""
    return (
        "Events per pixel and second at constant light, with 90 % intervals; ON and OFF of one level stand side by "
        f"side.{limits} Rates that rise as the light falls point to noise of the light itself, many more ON than OFF "
        "events to a leak or to hot pixels."
    )


def pixel(numbers: PixelNumbers, example: Example) -> str:
    """Caption of the example pixel."""
    point = example.point
    what = f"Point {point.index}, {waveform_label(point.waveform)} at {lux_label(point.baseline_lux)}"
    if point.log_contrast > 0.0:
        what += f", log contrast {point.log_contrast:.3g}"
    seen = f"{count(numbers.on_s.size, 'ON event')} and {count(numbers.off_s.size, 'OFF event')}"
    shaded = " Shaded: where an answer counts." if numbers.windows_s.size else ""
    model = (
        " The middle panel is what a model computes for the same light; it was not measured." if numbers.trace else ""
    )
    return (
        f"{what}: pixel x = {example.x}, y = {example.y}, one with the median number of events. In this stretch it "
        f"sent {seen}.{shaded}{model}"
    )


def latency(numbers: LatencyNumbers) -> str:
    """Caption of the latencies."""
    total = sum(int(item.counts.sum()) for _, members in numbers.panels for item in members)
    return (
        f"Time from the edge of a test pulse to the first event of its polarity, {count(total, 'answer')} in all. "
        "Above: all contrasts together; the marker stands on the fullest bin. Below: the median at each contrast "
        "with ten answers or more. Latencies that grow as the light falls show the bandwidth of the photoreceptor; "
        "those that are alike at all levels, that of the source follower or of the light source."
    )


def resets(numbers: ResetNumbers) -> str:
    """Caption of the reset figure."""
    verdict = f"Here the lowest is {100.0 * numbers.lowest_share:.1f} %"
    if numbers.lowest_share < ENOUGH_RESETS:
        verdict += ": there, part of the pixels compare with an old reference"
    return (
        "Above: the share of resets whose return fired the opposite polarity and so re-armed the pixel; below the "
        f"dashed line (95 %) a point is not to be trusted. {verdict}. Below: where each curve starts and ends. A "
        "floor above 0 is noise that fires without a step, a plateau below 1 steps that a pixel does not answer."
    )


def pixel_maps(numbers: PixelMapNumbers) -> str:
    """Caption of the maps of thresholds."""
    spreads = " ".join(_spread(spread) for spread, _ in numbers.maps)
    others = f" {count(numbers.others, 'more map')} in the tables." if numbers.others else ""
    return (
        "The 50 % point of each pixel, from its own answers; grey pixels have none. Of each polarity the curve is "
        f"shown that determines most pixels. {spreads}{others}"
    )


def _spread(spread: Spread) -> str:
    text = (
        f"{polarity_label(spread.key.polarity)}: {spread.pixels} of {spread.of} pixels have a threshold, with a "
        f"spread of {fixed(spread.total, 3)} ln"
    )
    if not np.isfinite(spread.own):
        return f"{text}."
    return f"{text}; counting so few pulses gives {fixed(spread.counting, 3)}, which leaves {fixed(spread.own, 3)}."


def event_map(numbers: EventMapNumbers) -> str:
    """Caption of the event map."""
    silent = f" {count(numbers.silent, 'pixel')} sent none." if numbers.silent else ""
    x, y = numbers.loudest
    scale = " The scale is logarithmic, because few pixels sent most of the events." if numbers.log_scale else ""
    return (
        f"{count(numbers.total, 'event')} of both polarities in all points; the median pixel sent "
        f"{numbers.median:g}, the loudest (x = {x}, y = {y}) {numbers.most}.{silent}{scale} Look for single bright "
        "pixels (hot), dark ones (dead) and gradients (uneven light)."
    )


def error_fall(numbers: ErrorFallNumbers) -> str:
    """Caption of the fall of the error."""
    return (
        f"The error of the model at each of {count(len(numbers.labels), 'step')}: the mean square residual, scaled "
        "so that a true model has 1 (dashed). Points that the fit did not see show whether an effect explains, or "
        "only bends. To the right the rms difference of measured and predicted response probabilities."
    )


def measured_predicted(numbers: MeasuredPredictedNumbers) -> str:
    """Caption of every statistic against what a model expects."""
    return (
        f"All statistics of the run, in {count(len(numbers.panels), 'view')}; each mark is one statistic of one "
        "point. Bars are 90 % intervals of the difference, from the scatter between pixels. On the line the model is "
        "right; what stands off it in one view alone tells what kind of effect is missing."
    )


def residual_axes(numbers: ResidualAxesNumbers) -> str:
    """Caption of the residuals against every axis."""
    several = len(numbers.steps) > 1
    lines = f"One line for each of {count(len(numbers.steps), 'step')}; grey" if several else "Grey"
    end = "; it is to be flat and in the grey in the end" if several else ""
    return (
        "The rms residual of all statistics at each value of what was varied, in standard errors; neighbouring "
        f"values are taken together where they are many. {lines} is where a true model lies by chance. A line that "
        f"is high at one end tells where the model fails{end}."
    )


def misfit_map(numbers: MisfitMapNumbers) -> str:
    """Caption of the map of residuals."""
    beside = " Left before anything was added, right in the end." if len(numbers.maps) > 1 else ""
    return (
        f"The rms residual of each kind of statistic, by {numbers.axis}, in standard errors; red where more was "
        f"measured than the model has, blue where less.{beside} A true model has about 1 everywhere."
    )


def ranking(numbers: RankingNumbers) -> str:
    """Caption of the ranking of the candidates."""
    return (
        f"The candidates at {count(len(numbers.steps), 'step')}: by how much the error would fall with each, as "
        "the residuals let expect (open bars), and after a refit (filled, of the best ones only). p is the chance "
        "that as much is expected of the best of all candidates where nothing is missing. Tied: the data cannot tell "
        "it from the one that was added."
    )
