"""A diagnosis, and a comparison, as a person reads them at a terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from bench.diagnosis.telling.quantities import also, number_text, quantity, size_text
from bench.diagnosis.views.registry import all_views

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from bench.diagnosis.comparison import Comparison, Residual
    from bench.diagnosis.recorded.position import Pattern
    from bench.diagnosis.result import Candidate, Error, Misfit, Outcome, Remainder, Step
    from bench.diagnosis.telling.by_axis import Axis, Change, Place

__all__ = [
    "apart_line",
    "blind",
    "change_text",
    "comparison_lines",
    "end_lines",
    "error_text",
    "fall_line",
    "fall_text",
    "gain_of",
    "head_line",
    "lines_of",
    "not_asked_lines",
    "number_lines",
    "on_axis",
    "p_text",
    "pattern_lines",
    "place_text",
    "remainder_text",
    "shortened_lines",
    "shortened_parts",
    "significant",
    "smallest",
    "smallest_lines",
    "step_lines",
    "verdict_line",
]

_SHOWN: Final = 5
_HEADS: Final = "expected fall   after refit   on unseen points   p"
_SMALLEST_P: Final = 0.001
_INDENT: Final = " " * 8
#: Where the error begins in the first line of a step, if there is room.
_COLUMN: Final = 76
#: Parts of a fit that are no physics.
_NOT_PHYSICS: Final = frozenset({"alignment"})
#: Units of logarithms of times, with what 0 stands for, s.
_LOG_TIMES: Final = {"ln s": 1.0, "ln us": 1e-6}
#: The worst of many statistics of a true model is as far off as this.
_FAR_Z: Final = 3.5
#: Below this a pattern among the pixels is chance.
_PATTERN_Z: Final = 3.5


def head_line(runs: Sequence[str], points: int, pixels: int, findings: Sequence[str]) -> str:
    """Return what is looked at, and whether it can be judged."""
    name = ("run " if len(runs) == 1 else "runs ") + ", ".join(runs)
    fit = "not fit to judge" if findings else "fit to judge"
    return f"{name}   {_count(points, 'point')}, {_count(pixels, 'pixel')}, {fit}"


def shortened_parts(text: str) -> list[str]:
    """Return how much of the recordings was looked at, where it was not all."""
    return [f"looked at {part}" for part in text.split("; ") if part]


def shortened_lines(text: str) -> Iterator[str]:
    """Yield how much of the recordings was looked at, where it was not all, and how all of it is."""
    yield from shortened_parts(text)
    if text:
        yield f"{_INDENT}more takes longer and sharpens little; --whole looks at all"


def lines_of(outcome: Outcome, places: Mapping[int, Place] | None = None) -> Iterator[str]:
    """Yield the lines of a whole diagnosis.

    Parameters
    ----------
    places
        By the number of the step: where its model fails most, and how that changes.
    """
    yield from shortened_lines(outcome.shortened)
    for step in outcome.steps:
        yield from step_lines(step, (places or {}).get(step.number), gain_of(outcome))
    yield from end_lines(outcome)


def end_lines(outcome: Outcome) -> Iterator[str]:
    """Yield what stands below the steps: the numbers of the last model, the verdict, what remains, what is next."""
    if outcome.steps:
        # A step tells its own numbers as they were then; what is added later moves them.
        yield "the model now, with 90 % intervals:"
        yield from number_lines(outcome.steps[-1])
    yield verdict_line(outcome)
    for one in outcome.remainder:
        yield f"{_INDENT}left over: {remainder_text(one)}"
    line = apart_line(outcome)
    if line is not None:
        yield line
    if outcome.verdict == "nothing_missing":
        yield from smallest_lines(outcome)
    yield from not_asked_lines(outcome)


def not_asked_lines(outcome: Outcome) -> Iterator[str]:
    """Yield the effects that could not be looked for, with the reason that each group of them has.

    That is told where something may be missing all the same.
    """
    if outcome.verdict not in ("nothing_missing", "unexplained"):
        return
    for why in dict.fromkeys(outcome.not_asked.values()):
        names = sorted(name for name, its in outcome.not_asked.items() if its == why)
        yield f"not looked for: {_listed(names)} ({why})"


def number_lines(step: Step) -> Iterator[str]:
    """Yield the numbers of a model, each with its unit and interval."""
    width = max((len(k) for k in step.parameters), default=0)
    for key, value in step.parameters.items():
        yield f"{_INDENT}{key:{width}}  {number_text(value)}"


def gain_of(outcome: Outcome) -> float | None:
    """Return the photocurrent at one lux, fA, if the model is known."""
    return None if outcome.model is None else outcome.model.photoconversion.gain_fa_per_lux


def step_lines(
    step: Step, place: Place | None = None, gain_fa_per_lux: float | None = None, *, numbered: bool = False
) -> Iterator[str]:
    """Yield the lines of one step: the model, its error, where it fails most, and what it may lack.

    Parameters
    ----------
    place
        Where the model fails most; without it the worst statistic is told.
    gain_fa_per_lux
        Photocurrent at one lux: turns a dark current into light.
    numbered
        Show all candidates, each with its number.
    """
    head = f"step {step.number}  {_what(step, gain_fa_per_lux)}"
    yield f"{head:<{_COLUMN}}   {error_text(step.error)}".rstrip()
    if place is not None:
        yield f"{_INDENT}fails most: {place_text(place)}"
    elif step.worst and abs(step.worst[0].z) >= _FAR_Z:
        yield f"{_INDENT}fails most: {_misfit(step.worst[0])}"
    yield from _numbered(step.candidates) if numbered else _candidates(step.candidates)


def fall_line(before: Step, after: Step) -> str:
    """Return how far the error fell by a step."""
    first, last = before.error, after.error
    fit = f"{significant(first.deviance_per_dof)} to {significant(last.deviance_per_dof)}"
    unseen = f"{significant(first.heldout_deviance_per_dof)} to {significant(last.heldout_deviance_per_dof)}"
    return f"{_INDENT}the error went from {fit}, on unseen points from {unseen}"


def _what(step: Step, gain_fa_per_lux: float | None) -> str:
    if step.added is None:
        return ", ".join(e.replace("_", " ") for e in step.effects if e not in _NOT_PHYSICS)
    mine = {k: v for k, v in step.parameters.items() if k.split(".")[0] == step.added}
    numbers = [number_text(v) for v in mine.values()]
    numbers += [text for k, v in mine.items() if (text := also(k, v, gain_fa_per_lux)) is not None]
    return f"+ {step.added} {', '.join(numbers)}".rstrip()


def error_text(error: Error) -> str:
    """Return the error of a model, with its floor."""
    return (
        f"error {significant(error.deviance_per_dof)}   on unseen points "
        f"{significant(error.heldout_deviance_per_dof)}   response rms {error.response_rmse:.3f}   floor 1.00"
    )


def _candidates(candidates: Sequence[Candidate]) -> Iterator[str]:
    shown = [c for c in candidates if c.screen_drop > 0.0 or c.refit_drop is not None][:_SHOWN]
    if not shown:
        return
    width = max(9, *(len(c.effect) for c in shown))
    yield f"{_INDENT}{'candidate':{width}}  {_HEADS}"
    for one in shown:
        yield f"{_INDENT}{_row(one, width)}"


def _numbered(candidates: Sequence[Candidate]) -> Iterator[str]:
    if not candidates:
        return
    width = max(9, *(len(c.effect) for c in candidates))
    yield f"{_INDENT}    {'candidate':{width}}  {_HEADS}"
    for number, one in enumerate(candidates, start=1):
        yield f"{_INDENT}{number:2}  {_row(one, width)}"


def _row(one: Candidate, width: int) -> str:
    tied = f"   cannot be told from {_listed(one.tied_with, 'or')} here" if one.tied_with else ""
    falls = f"{fall_text(one.screen_drop):>13}   {fall_text(one.refit_drop):>11}   {fall_text(one.heldout_drop):>16}"
    return f"{one.effect:{width}}  {falls}   {p_text(one.p_value):7}{tied}".rstrip()


def fall_text(fall: float | None) -> str:
    """Return by how much an error would fall, or a dash where that is not known."""
    return "-" if fall is None or not math.isfinite(fall) else significant(fall)


def p_text(p_value: float) -> str:
    """Return a p-value as it is printed: none smaller than it is worth."""
    return f"< {_SMALLEST_P:g}" if p_value < _SMALLEST_P else f"{p_value:.3f}"


def place_text(place: Place) -> str:
    """Return where a model fails, in which direction, and how that changes along each axis."""
    one = place.worst
    return "; ".join([_far_off(one, one.view, one.part, one.unit), *map(change_text, place.changes)])


def change_text(change: Change) -> str:
    """Return how a failure changes along an axis: ``grows as the light falls, flat from 10 lux on``."""
    words = {
        "illuminance": ("grows with the light", "grows as the light falls"),
        "contrast": ("grows with the contrast", "grows as the contrast falls"),
        "pulse width": ("grows with longer pulses", "grows as the pulses get shorter"),
        "ND filter": ("grows with the density of the ND filter", "grows as the ND filter gets lighter"),
        "order": ("grows during the run", "fades during the run"),
    }
    up, down = words.get(change.axis, (f"grows along {change.axis}", f"falls along {change.axis}"))
    if change.way == "peaks":
        return f"largest at {on_axis(change.axis, change.at)}"
    text = up if change.way == "grows" else down
    if change.way == "grows" and change.flat_below is not None:
        text += f", flat up to {on_axis(change.axis, change.flat_below)}"
    if change.way == "falls" and change.flat_above is not None:
        text += f", flat from {on_axis(change.axis, change.flat_above)} on"
    return text


def on_axis(axis: Axis, value: float) -> str:
    """Return a value of an axis with its unit."""
    unit = {"illuminance": "lux", "contrast": "ln", "pulse width": "s", "ND filter": "OD", "order": "point"}.get(axis)
    if axis == "contrast":
        return f"a contrast of {value:.2g}"
    return f"point {value:.0f}" if axis == "order" else quantity(value, unit or "1")


def view_text(view: str, part: str) -> str:
    """Return what a view of one polarity is called in a sentence."""
    name = view.replace("_", " ")
    return name if part == "both" else f"{part.upper()} {name}"


def _misfit(one: Misfit) -> str:
    view, _, part = one.view.rpartition("_")
    if part not in ("on", "off"):
        view, part = one.view, "both"
    # A view of a file that is not loaded here is told as a plain number.
    unit = {known.id: known.unit for known in all_views()}.get(view, "1")
    return _far_off(one, view, part, unit)


def _far_off(one: Misfit | Residual, view: str, part: str, unit: str) -> str:
    return (
        f"{view_text(view, part)} at {_conditions(one.baseline_lux, one.log_contrast)}: "
        f"measured {_in_unit(one.observed, unit)}, model {_in_unit(one.predicted, unit)} ({one.z:+.0f} sigma)"
    )


def _conditions(lux: float, contrast: float) -> str:
    return quantity(lux, "lux") + (f", contrast {contrast:.3g}" if contrast > 0.0 else "")


def _in_unit(value: float, unit: str) -> str:
    """Return a statistic with its unit; the mean logarithm of a time as that time."""
    if unit in _LOG_TIMES and math.isfinite(value):
        return quantity(_LOG_TIMES[unit] * math.exp(value), "s")
    return f"{value:.3g}" if unit in ("1", *_LOG_TIMES) else f"{value:.3g} {unit}"


def verdict_line(outcome: Outcome) -> str:
    """Return the verdict in one sentence."""
    if outcome.verdict == "data_not_fit_to_judge":
        return f"verdict: the data are not fit to be judged: {'; '.join(outcome.findings)}"
    first, last = (significant(outcome.steps[i].error.deviance_per_dof) for i in (0, -1))
    names = _listed([with_ties(outcome, name) for name in outcome.missing])
    number = len(outcome.missing)
    many = "one effect was" if number == 1 else f"{_SMALL_NUMBERS.get(number, str(number))} effects were"
    if outcome.verdict == "nothing_missing":
        return f"verdict: nothing is missing. The error is {first}, and no known effect would lower it beyond chance."
    if outcome.verdict == "explained":
        rest = "the search was stopped, and more may be missing" if outcome.stopped else "nothing else is significant"
        return f"verdict: {many} missing, {names}. The error fell from {first} to {last}; {rest}."
    if outcome.stopped:
        added = [step.added for step in outcome.steps if step.added is not None]
        so_far = f"With {_listed(added)} the error fell from {first} to {last}" if added else f"The error is {first}"
        return f"verdict: unexplained so far. {so_far}; the search was stopped before all that is known was tried."
    if outcome.missing:
        return (
            f"verdict: unexplained. With {names} the error fell from {first} to {last}, but something is left that "
            "no known effect explains."
        )
    return f"verdict: unexplained. No known effect explains the error of {first}."


def with_ties(outcome: Outcome, name: str) -> str:
    """Return an effect with those that it cannot be told from."""
    tied = outcome.ties.get(name, ())
    return f"{name} (or {_listed(tied, 'or')})" if tied else name


def apart_line(outcome: Outcome) -> str | None:
    """Return what to measure next, that nothing known would help, or None where there is nothing to tell apart."""
    following = outcome.next_measurement
    if following is None:
        return None
    if not following:
        groups = "; ".join(_listed([name, *tied]) for name, tied in outcome.ties.items())
        return f"no protocol that is known here tells {groups} apart" if groups else None
    names = list(following.get("separates", ()))
    which = f"the {_SMALL_NUMBERS.get(len(names), str(len(names)))}" if names else "them"
    parts = [str(following.get("title") or following.get("protocol"))]
    minutes, sigma = following.get("minutes"), following.get("separation")
    if isinstance(minutes, int | float) and math.isfinite(minutes):
        parts.append(f"{minutes:.0f} minutes" if minutes >= 1.0 else "under a minute")
    if isinstance(sigma, int | float) and math.isfinite(sigma):
        far = sigma > _FAR_APART
        parts.append(f"separation over {_FAR_APART:.0f} sigma" if far else f"separation {sigma:.0f} sigma")
    said = ", ".join(parts)
    if names and not set(names[1:]) <= set(outcome.ties.get(names[0], ())):  # some were only nearly as good
        return f"to be sure of {names[0]} rather than {_listed(names[1:], 'or')}: {said}"
    named = f" ({_listed(names, 'from' if len(names) == _TWO else 'and')})" if names else ""
    return f"to tell {which} apart{named}: {said}"


#: Standard errors beyond which it does not matter how many: what is so gross is no straight line.
_FAR_APART: Final = 100.0
_SMALL_NUMBERS: Final = {2: "two", 3: "three"}
_TWO: Final = 2


def smallest(outcome: Outcome) -> list[tuple[str, str]]:
    """Return the smallest size of each effect that would have been seen beside the last step's model."""
    known = [(c.effect, c.smallest) for c in outcome.steps[-1].candidates] if outcome.steps else []
    return [(e, size_text(e, size)) for e, size in sorted(known) if size is not None and math.isfinite(size)]


def smallest_lines(outcome: Outcome) -> Iterator[str]:
    """Yield the smallest size of each effect that would have been seen, and which would not."""
    sizes = smallest(outcome)
    if sizes:
        yield "smallest size that would have been seen:"
        width = max(len(effect) for effect, _ in sizes)
        for effect, size in sizes:
            yield f"{_INDENT}{effect:{width}}  {size}"
    unseen = blind(outcome)
    if unseen:
        yield f"not to be seen in these data at any size: {_listed(unseen)}"


def blind(outcome: Outcome) -> list[str]:
    """Return the effects that would not have been seen beside the last step's model, however large they are."""
    told = {effect for effect, _ in smallest(outcome)}
    candidates = outcome.steps[-1].candidates if outcome.steps else ()
    return sorted(c.effect for c in candidates if c.effect not in told)


def comparison_lines(comparison: Comparison, places: Sequence[Place], found: Sequence[Pattern]) -> Iterator[str]:
    """Yield the lines of a comparison: the numbers of the model, its error, and where it fails."""
    step = comparison.step
    yield from shortened_lines(comparison.shortened)
    yield from (f"not fit to judge: {finding}" for finding in comparison.findings)
    yield f"{_what(step, None)}   {error_text(step.error)}"
    yield from number_lines(step)
    if places:
        yield "fails most:"
        for place in places:
            yield f"{_INDENT}{place_text(place)}"
    else:
        yield "no statistic is off by more than chance"
    yield from (f"{_INDENT}{line}" for line in pattern_lines(found))


def pattern_lines(found: Sequence[Pattern]) -> Iterator[str]:
    """Yield the patterns among the pixels that are beyond chance, in words."""
    for one in found:
        if one.z > _PATTERN_Z or (one.along.startswith("from") and abs(one.z) > _PATTERN_Z):
            yield _pattern_text(one)


def _pattern_text(one: Pattern) -> str:
    if one.along in ("rows", "columns"):
        return (
            f"{one.along} of pixels differ, by {one.size:.2g} rms ({one.z:+.0f} sigma); the model has no place for it"
        )
    return f"pixels differ {one.along}, by {one.size:+.2g} ({one.z:+.0f} sigma); the model has no place for it"


def remainder_text(one: Remainder) -> str:
    """Return where something is left that nothing explains."""
    axis = one.axis.replace("_", " ")
    size, z = significant(one.size), significant(one.z)
    return f"{axis} {one.where}: rms {size} standard errors, {z} sigma beyond chance"


def significant(value: float) -> str:
    """Return a number with three digits and no exponent: ``41.7``, ``1.06``, ``1430``."""
    if not math.isfinite(value):
        return "unknown"
    size = abs(value)
    return f"{value:.0f}" if size >= 100.0 else f"{value:.1f}" if size >= 10.0 else f"{value:.2f}"


def _listed(names: Sequence[str], last: str = "and") -> str:
    names = list(names)
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}" if names else ""


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")
