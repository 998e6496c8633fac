"""What the plots of the page show: S-curves by polarity and light level, and background rates, as plain values."""

from __future__ import annotations

import math
from bisect import bisect_left
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Sequence

    from bench.analysis.grouping import Entry
    from bench.analysis.results import BackgroundRow, CurveKey
    from bench.report.families import Family, Step
    from bench.watch.counting import PointCounts, Response
    from bench.watch.planned import PlannedLook

__all__ = ["background_panel", "number", "response_families"]

_Condition = tuple[object, ...]
_ROOM: Final = 0.03


def number(value: float, digits: int = 6) -> float | None:
    """Return `value` with so many significant digits, None if it is not finite: JSON has no such numbers."""
    return float(f"{value:.{digits}g}") if math.isfinite(value) else None


def response_families(counts: Collection[PointCounts], planned: Collection[PlannedLook]) -> list[dict[str, Any]]:
    """Return the S-curves of all points that were counted, sorted as in the report.

    Parameters
    ----------
    counts
        Of each point.
    planned
        The plan, where it is known: axes and colours stay what they are while the run goes on.
    """
    from bench.report.families import families_of

    found = [(point.index, response) for point in counts for response in point.responses]
    keys = _keys([response for _, response in found], counts)
    members: dict[CurveKey, list[tuple[int, Response]]] = {}
    for key, item in zip(keys, found, strict=True):
        members.setdefault(key, []).append(item)
    return [_family(family, members, planned) for family in families_of(sorted(members, key=_order))]


def _order(key: CurveKey) -> tuple[str, str, float, float, float, str]:
    return key.settings, key.waveform, key.pulse_width_s, key.baseline_lux, key.nd_od, key.polarity


def _keys(responses: Sequence[Response], counts: Collection[PointCounts]) -> list[CurveKey]:
    """Return the S-curve to which each response belongs, as the analysis of the whole run sorts them.

    Thousands of points share a few conditions, and only those are sorted.
    """
    from bench.analysis.grouping import curve_keys

    conditions = [_condition(response.entry) for response in responses]
    first: dict[_Condition, Entry] = {}
    for condition, response in zip(conditions, responses, strict=True):
        first.setdefault(condition, response.entry)
    labels = _labels(counts)
    keys = curve_keys(list(first.values()), [labels[_settings(entry.bias)] for entry in first.values()])
    of_condition = dict(zip(first, keys, strict=True))
    return [of_condition[condition] for condition in conditions]


def _condition(entry: Entry) -> _Condition:
    test = entry.tally.test
    lengths = (f"{value:.4g}" for value in (test.width_s, test.window_s, test.reset_log_contrast))
    return (
        entry.waveform, test.polarity, entry.baseline_lux, entry.nd_od, entry.roi, _settings(entry.bias), *lengths,
    )  # fmt: skip


def _settings(bias: dict[str, float]) -> tuple[tuple[str, float], ...]:
    return tuple(sorted(bias.items()))


def _labels(counts: Collection[PointCounts]) -> dict[tuple[tuple[str, float], ...], str]:
    """Return how each bias setting of the run is called; empty where there is only one."""
    from bench.analysis.grouping import settings_labels

    different = {_settings(point.bias): point.bias for point in counts}
    return dict(zip(different, settings_labels(list(different.values())), strict=True))


def _family(
    family: Family, members: dict[CurveKey, list[tuple[int, Response]]], planned: Collection[PlannedLook]
) -> dict[str, Any]:
    mine = [(key, step) for key in members if (step := family.step_of(key)) is not None]
    alike = [look for look in planned if look.waveform == mine[0][0].waveform]
    colours = _step_colours(family, {look.baseline_lux for look in alike})
    contrasts = [response.log_contrast for key, _ in mine for _, response in members[key]]
    panels = []
    for polarity in ("on", "off"):
        curves = [_curve(step, members[key], colours) for key, step in mine if key.polarity == polarity]
        if curves:
            panels.append({"polarity": polarity, "curves": sorted(curves, key=lambda curve: curve["step"])})
    return {
        "title": family.title,
        "steps": [{"label": step.label, **colours[step.index]} for step in family.steps],
        "x": _contrast_axis([*contrasts, *(look.log_contrast for look in alike if look.log_contrast > 0.0)]),
        "panels": panels,
    }


def _curve(step: Step, items: Iterable[tuple[int, Response]], colours: Sequence[dict[str, Any]]) -> dict[str, Any]:
    points = [
        [index, number(r.log_contrast), number(r.probability), number(r.low), number(r.high)]
        for index, r in sorted(items, key=lambda item: (item[1].log_contrast, item[0]))
    ]
    return {"step": step.index, **colours[step.index], "points": points}


def _step_colours(family: Family, planned_lux: set[float]) -> list[dict[str, Any]]:
    """Return colour and marker of each step; those of a light level do not change when others join it."""
    from bench.report.figures import style

    places, total = [step.index for step in family.steps], len(family.steps)
    levels = sorted(planned_lux)
    own = [bisect_left(levels, step.value) for step in family.steps]
    if family.axis == "level" and len(set(own)) == total and {step.value for step in family.steps} <= planned_lux:
        places, total = own, len(levels)
    return [
        {"colour": _hex(style.step_colour(place, total)), "marker": style.MARKERS[place % len(style.MARKERS)]}
        for place in places
    ]


def _hex(colour: Sequence[float]) -> str:
    return "#" + "".join(f"{round(255 * part):02x}" for part in colour[:3])


def _contrast_axis(contrasts: Sequence[float]) -> dict[str, Any]:
    from matplotlib.ticker import MaxNLocator

    from bench.report.figures.style import linear_contrast_ticks

    low, high = min(contrasts), max(contrasts)
    room = _ROOM * (high - low) if high > low else 0.05 * high or 0.05
    low, high = max(0.0, low - room), high + room
    ticks = MaxNLocator(6, steps=[1, 2, 5, 10]).tick_values(low, high)
    linear = linear_contrast_ticks(low, high).tolist()
    return {
        "ends": [number(low), number(high)],
        "ticks": [[number(tick), f"{tick:.6g}"] for tick in ticks if low <= tick <= high],
        "top": [[number(math.log1p(tick)), f"{tick:g}"] for tick in linear],
    }


def background_panel(counts: Iterable[PointCounts]) -> dict[str, Any] | None:
    """Return the background rates of all constant points that were counted; None where there are none."""
    from bench.report.figures import background, style
    from bench.report.wording import lux_label

    rows = sorted((row for point in counts for row in point.background), key=lambda row: row.point)
    numbers = background.prepare(rows)
    if numbers is None:
        return None
    ticks = style.log_axis_ticks(*numbers.x_limits, fewest=3).tolist()
    labels = [[number(t), lux_label(t)] for t in ticks if numbers.dark_at is None or t > 1.5 * numbers.dark_at]
    if numbers.dark_at is not None:
        labels.insert(0, [number(numbers.dark_at), "dark"])
    heights = style.log_axis_ticks(*numbers.y_limits).tolist()
    return {
        "x": {"ends": [number(v) for v in numbers.x_limits], "ticks": labels},
        "y": {"ends": [number(v) for v in numbers.y_limits], "ticks": [[number(t), _plain(t)] for t in heights]},
        "rates": [_rate(row, place) for row, place in _placed(rows, numbers)],
    }


def _placed(rows: Sequence[BackgroundRow], numbers: Any) -> Iterable[tuple[BackgroundRow, float]]:
    """Yield each row that is drawn with its place on the axis of light levels."""
    usable = [row for row in rows if math.isfinite(row.rate.high) and row.rate.high > 0.0]
    for rates in numbers.rates:
        mine = [row for row in usable if row.polarity == rates.polarity]
        yield from zip(mine, rates.place.tolist(), strict=True)


def _rate(row: BackgroundRow, place: float) -> dict[str, Any]:
    from bench.report.figures.style import POLARITY_COLOURS, POLARITY_MARKERS

    return {
        "point": row.point,
        "polarity": row.polarity,
        "colour": POLARITY_COLOURS[row.polarity],
        "marker": POLARITY_MARKERS[row.polarity],
        "lux": number(row.baseline_lux),
        "x": number(place),
        "rate": number(row.rate.value),
        "low": number(row.rate.low),
        "high": number(row.rate.high),
        "limit": row.events == 0,
    }


def _plain(value: float) -> str:
    text = f"{value:.9f}"
    return text.rstrip("0").rstrip(".")
