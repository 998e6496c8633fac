"""Which figures a run gets, in which order, and what their captions say."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.report import captions
from bench.report.example import choose_example, pixel_events
from bench.report.families import families_of
from bench.report.figures import (
    background,
    event_map,
    latency,
    pixel,
    pixel_maps,
    resets,
    scurves,
    thresholds,
)
from bench.report.showing import Picture

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.analysis.results import Analysis
    from bench.report.example import RunLike
    from bench.report.families import Family
    from bench.report.trace import ModelTrace

__all__ = ["pictures"]


def pictures(run: RunLike, analysis: Analysis, model_trace: ModelTrace | None) -> Iterator[Picture]:
    """Yield the figures that make sense for this run, most important first."""
    families = families_of([*(c.key for c in analysis.curves), *(r.key for r in analysis.responses)])
    for family in families:
        yield from _curve_pictures(analysis, family)
    yield from _background_picture(analysis)
    yield from _pixel_picture(run, analysis, model_trace)
    for family in families:
        yield from _answer_pictures(analysis, family)
    yield from _map_pictures(analysis)


def _named(name: str, title: str, family: Family) -> tuple[str, str]:
    """Return the name and title of a figure; where a run has several families, both say which."""
    return (f"{name}_{family.name}", f"{title}: {family.title}") if family.name else (name, title)


def _curve_pictures(analysis: Analysis, family: Family) -> Iterator[Picture]:
    curves = scurves.prepare(analysis.curves, family)
    if curves is not None:
        name, title = _named("s_curves", "S-curves", family)
        yield Picture(name, title, captions.scurves(curves, family), lambda: scurves.draw(curves))
    readings = thresholds.prepare(analysis.curves, family)
    if readings is not None:
        against = {"level": "illuminance", "width": "pulse length", "settings": "settings"}[family.axis]
        name, title = _named("thresholds", f"Threshold against {against}", family)
        yield Picture(name, title, captions.thresholds(readings, family), lambda: thresholds.draw(readings))


def _background_picture(analysis: Analysis) -> Iterator[Picture]:
    rates = background.prepare(analysis.background)
    if rates is not None:
        yield Picture("background", "Background rates", captions.background(rates), lambda: background.draw(rates))


def _pixel_picture(run: RunLike, analysis: Analysis, model_trace: ModelTrace | None) -> Iterator[Picture]:
    example = choose_example(run, analysis)
    if example is not None:
        numbers = pixel.prepare(example, *pixel_events(example), model_trace)
        yield Picture("pixel", "One pixel", captions.pixel(numbers, example), lambda: pixel.draw(numbers))


def _answer_pictures(analysis: Analysis, family: Family) -> Iterator[Picture]:
    latencies = latency.prepare(analysis.responses, family)
    if latencies is not None:
        name, title = _named("latency", "Latencies", family)
        yield Picture(name, title, captions.latency(latencies), lambda: latency.draw(latencies))
    answered = resets.prepare(analysis.responses, analysis.curves, family)
    if answered is not None:
        name, title = _named("resets", "Resets, floor and plateau", family)
        yield Picture(name, title, captions.resets(answered), lambda: resets.draw(answered))


def _map_pictures(analysis: Analysis) -> Iterator[Picture]:
    own = pixel_maps.prepare(analysis.pixel_maps, analysis.event_map_origin)
    if own is not None:
        yield Picture(
            "pixel_thresholds", "Thresholds of single pixels", captions.pixel_maps(own), lambda: pixel_maps.draw(own)
        )
    events = event_map.prepare(analysis)
    if events is not None:
        yield Picture("event_map", "Events of each pixel", captions.event_map(events), lambda: event_map.draw(events))
