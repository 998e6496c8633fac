"""A diagnosis as it reads at a terminal."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from bench.diagnosis.result import Misfit, Outcome, Remainder, Value
from bench.diagnosis.telling.axis_wording import axis_lines
from bench.diagnosis.telling.by_axis import Change, by_axis, worst_places
from bench.diagnosis.telling.quantities import number_text, quantity
from bench.diagnosis.telling.wording import (
    apart_line,
    change_text,
    fall_line,
    head_line,
    lines_of,
    place_text,
    step_lines,
    verdict_line,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.diagnosis.comparison import Residual


def test_a_whole_diagnosis_reads_like_the_table_that_was_asked_for(explained: Outcome) -> None:
    text = "\n".join(lines_of(explained))
    assert "step 0  thresholds, noise floor, source follower bandwidth, refractory period" in text
    assert "error 41.7" in text
    assert "floor 1.00" in text
    assert "fails most: ON response at 80 mlux, contrast 0.45: measured 0.11, model 0.97 (-88 sigma)" in text
    # 5.52 fA over 42.4 fA/lux times 0.6 are 217 mlux
    assert "step 1  + dark_current 5.52 fA (5.41 to 5.63), dark light 217 mlux" in text
    row = next(line.split() for line in text.splitlines() if line.split()[:1] == ["dark_current"])
    assert row[1:6] == ["30.2", "40.6", "41.5", "<", "0.001"]
    assert "41.5   < 0.001   cannot be told from stray_light here" in text
    assert (
        "verdict: one effect was missing, dark_current (or stray_light). The error fell from 41.7 to 1.06; "
        "nothing else is significant." in text
    )
    assert "alignment" not in text
    assert not any(line.split()[:2] == ["leak", "0.00"] for line in text.splitlines())  # it would lower nothing
    assert all(len(line) < 200 for line in text.splitlines())


def test_the_numbers_of_the_last_model_stand_above_the_verdict(explained: Outcome) -> None:
    first, last = explained.steps
    dark = replace(last.parameters["dark_current.mean_fa"], value=5.6)
    later = replace(last, number=2, added="leak", parameters=last.parameters | {"dark_current.mean_fa": dark})
    lines = list(lines_of(replace(explained, steps=(first, last, later))))
    below = lines[lines.index("the model now, with 90 % intervals:") : lines.index(verdict_line(explained))]
    assert [x.split(maxsplit=1) for x in below].count(["dark_current.mean_fa", "5.60 fA (5.41 to 5.63)"]) == 1
    assert len(below) == 1 + len(later.parameters)


def test_what_tells_tied_effects_apart_is_told_with_its_time(explained: Outcome) -> None:
    line = "to tell the two apart (dark_current from stray_light): on_family, 12 minutes, separation 19 sigma"
    assert apart_line(explained) == line
    assert apart_line(replace(explained, next_measurement=None)) is None
    assert apart_line(replace(explained, next_measurement={})) == (
        "no protocol that is known here tells dark_current and stray_light apart"
    )
    assert apart_line(replace(explained, next_measurement={}, ties={})) is None  # it is a rival's
    three = {"protocol": "pulse_width", "title": "pulse_width", "separates": ["a", "b", "c"], "minutes": 3.0}
    assert apart_line(replace(explained, next_measurement=three, ties={"a": ("b", "c")})) == (
        "to tell the three apart (a, b and c): pulse_width, 3 minutes"
    )


def test_what_was_only_nearly_as_good_is_not_called_tied(explained: Outcome) -> None:
    names = ["dark_current", "stray_light", "photoreceptor_bandwidth"]
    following = {"protocol": "pulse_width", "title": "pulse_width", "separates": names, "minutes": 17.0}
    assert apart_line(replace(explained, next_measurement=following)) == (
        "to be sure of dark_current rather than stray_light or photoreceptor_bandwidth: pulse_width, 17 minutes"
    )


def test_what_could_not_be_looked_for_is_told_where_something_may_be_missing_all_the_same(
    nothing_missing: Outcome, explained: Outcome
) -> None:
    why = {"nd_error": "no filter was in the light", "contrast_error": "thresholds", "injection_offset": "thresholds"}
    lines = list(lines_of(replace(nothing_missing, not_asked=why)))
    assert lines[-2:] == [
        "not looked for: nd_error (no filter was in the light)",
        "not looked for: contrast_error and injection_offset (thresholds)",
    ]
    assert lines == [*lines_of(nothing_missing), *lines[-2:]]
    assert "not looked for" in "\n".join(lines_of(replace(explained, verdict="unexplained", not_asked=why)))
    assert "not looked for" not in "\n".join(lines_of(replace(explained, not_asked=why)))


def test_nothing_missing_says_what_would_have_been_seen(nothing_missing: Outcome) -> None:
    text = "\n".join(lines_of(nothing_missing))
    assert "verdict: nothing is missing. The error is 1.02" in text
    assert "smallest size that would have been seen:\n        leak  0.021 ln/s (rate_per_s)" in text
    assert text.endswith("not to be seen in these data at any size: shot_noise")


def test_every_verdict_is_one_sentence(explained: Outcome) -> None:
    bad = replace(explained, verdict="data_not_fit_to_judge", findings=("point 3: 12 gaps", "saturated"))
    assert verdict_line(bad) == "verdict: the data are not fit to be judged: point 3: 12 gaps; saturated"
    part = replace(explained, verdict="unexplained", remainder=(Remainder("pulse_width", "20.5 ms", 2.5, 6.1),))
    assert "unexplained. With dark_current (or stray_light) the error fell from 41.7 to 1.06, but" in verdict_line(
        part
    )
    assert "        left over: pulse width 20.5 ms: rms 2.50 standard errors, 6.10 sigma beyond chance" in lines_of(
        part
    )
    none = replace(explained, verdict="unexplained", missing=(), steps=explained.steps[:1])
    assert verdict_line(none) == "verdict: unexplained. No known effect explains the error of 41.7."
    assert verdict_line(replace(none, stopped=True)) == (
        "verdict: unexplained so far. The error is 41.7; the search was stopped before all that is known was tried."
    )
    assert verdict_line(replace(explained, stopped=True)).endswith("the search was stopped, and more may be missing.")
    stopped = verdict_line(replace(explained, verdict="unexplained", missing=(), stopped=True))
    assert "so far. With dark_current the error fell from 41.7 to 1.06; the search was stopped" in stopped
    two = replace(explained, missing=("dark_current", "leak"))
    assert "two effects were missing, dark_current (or stray_light) and leak." in verdict_line(two)


def test_a_diagnosis_without_steps_has_a_verdict_still(explained: Outcome) -> None:
    bad = replace(
        explained, verdict="data_not_fit_to_judge", findings=("saturated",), steps=(), next_measurement=None
    )
    assert list(lines_of(bad)) == ["verdict: the data are not fit to be judged: saturated"]


def test_what_was_looked_at_is_told_where_it_is_not_all(explained: Outcome) -> None:
    assert not [line for line in lines_of(explained) if line.startswith("looked at")]
    part = replace(explained, shortened="64 x 64 of 100 x 100 pixels; the beginning of 2 of 3 recordings")
    lines = list(lines_of(part))
    assert lines[:2] == ["looked at 64 x 64 of 100 x 100 pixels", "looked at the beginning of 2 of 3 recordings"]
    assert "--whole looks at all" in lines[2]


def test_the_head_says_whether_the_data_can_be_judged() -> None:
    assert head_line(["a"], 50, 256, ()) == "run a   50 points, 256 pixels, fit to judge"
    assert head_line(["a", "b"], 1, 256, ("gaps",)) == "runs a, b   1 point, 256 pixels, not fit to judge"


def test_where_a_model_fails_is_told_with_how_it_changes(
    residuals_of: Callable[[float], tuple[Residual, ...]],
) -> None:
    (first, *_) = worst_places(residuals_of(88.0))
    assert place_text(first).startswith("ON response at 80 mlux, contrast 0.3: measured 0.11, model 0.97 (-88 sigma)")
    assert place_text(first).endswith("; grows as the light falls, flat from 10 lux on")
    rate = replace(first, worst=replace(first.worst, view="background", log_contrast=0.0, unit="Hz"), changes=())
    assert place_text(rate) == "ON background at 80 mlux: measured 0.11 Hz, model 0.97 Hz (-88 sigma)"
    latency = next(p for p in worst_places(residuals_of(88.0)) if p.worst.view == "latency")
    assert "measured 2.48 ms, model 1.5 ms" in place_text(latency)
    of_all = replace(
        latency.worst, view="burst", part="both", observed=math.log(740.0), predicted=math.log(50.4), unit="ln us"
    )
    assert "burst at" in place_text(replace(latency, worst=of_all))
    assert "measured 740 us, model 50.4 us" in place_text(replace(latency, worst=of_all))
    spread = replace(latency.worst, view="latency_spread", observed=0.25, predicted=0.125, unit="ln^2")
    assert "measured 0.25 ln^2, model 0.125 ln^2" in place_text(replace(latency, worst=spread))


@pytest.mark.parametrize(
    ("view", "text"),
    [
        ("background_off", "OFF background at 80 mlux: measured 0.25 Hz, model 0.125 Hz (+9 sigma)"),
        ("latency_on", "ON latency at 80 mlux: measured 1.28 s, model 1.13 s (+9 sigma)"),
        ("burst", "burst at 80 mlux: measured 1.28 us, model 1.13 us (+9 sigma)"),
        ("extra_events", "extra events at 80 mlux: measured 0.25 events/pulse, model 0.125 events/pulse (+9 sigma)"),
        ("same_polarity", "same polarity at 80 mlux: measured 0.25, model 0.125 (+9 sigma)"),
        ("of_a_file_on", "ON of a file at 80 mlux: measured 0.25, model 0.125 (+9 sigma)"),
    ],
)
def test_the_worst_place_of_a_step_is_told_in_the_unit_of_its_view(explained: Outcome, view: str, text: str) -> None:
    step = replace(explained.steps[0], worst=(Misfit(view, 3, 0.08, 0.0, 0.25, 0.125, 9.0),))
    assert f"fails most: {text}" in "\n".join(step_lines(step))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (Change("contrast", "grows", 0.8, None, 0.2), "grows with the contrast, flat up to a contrast of 0.2"),
        (Change("pulse width", "falls", 0.01, 0.1, None), "grows as the pulses get shorter, flat from 100 ms on"),
        (Change("illuminance", "peaks", 3.0, 10.0, 0.1), "largest at 3 lux"),
        (Change("order", "grows", 40.0, None, None), "grows during the run"),
    ],
)
def test_changes_along_an_axis_are_words(change: Change, text: str) -> None:
    assert change_text(change) == text


def test_no_statistic_is_called_failing_that_chance_takes_as_far(explained: Outcome) -> None:
    step = explained.steps[0]
    near = replace(step, worst=(replace(step.worst[0], z=-2.9),))
    assert not any("fails most" in line for line in step_lines(near))


def test_numbers_have_the_digits_that_their_interval_deserves() -> None:
    assert number_text(Value(8.123e-3, 8.01e-3, 8.24e-3, "s")) == "8.12 ms (8.01 to 8.24)"
    assert number_text(Value(0.30991, 0.308, 0.312, "ln")) == "0.3099 ln (0.3080 to 0.3120)"
    assert number_text(Value(0.25, 0.1, 0.4, "1")) == "0.25 (0.10 to 0.40)"
    assert number_text(Value(12.0, 9.0, float("inf"), "Hz/fA")).endswith("to no limit)")
    assert quantity(0.08, "lx") == "80 mlux"
    assert quantity(2.5e-5, "s") == "25 us"


def test_the_fall_of_a_step_is_told(explained: Outcome) -> None:
    line = fall_line(*explained.steps)
    assert line.strip() == "the error went from 41.7 to 1.06, on unseen points from 42.5 to 1.08"


def test_every_view_and_every_axis_that_was_varied_has_its_table(
    residuals_of: Callable[[float], tuple[Residual, ...]],
) -> None:
    lines = list(axis_lines(by_axis(residuals_of(88.0))))
    heads = [line.split("  ")[0] for line in lines if "statistics" in line]
    assert heads == ["view", "illuminance on chip", "log contrast", "polarity", "points in their order"]
    dark = next(line for line in lines if line.startswith("80 mlux"))
    bright = next(line for line in lines if line.startswith("100 lux"))
    assert "*" in dark
    assert "*" not in bright
