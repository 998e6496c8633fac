"""Which S-curves stand in one figure."""

from __future__ import annotations

from collections.abc import Callable

from bench.analysis.results import CurveKey
from bench.report.families import families_of

Maker = Callable[..., CurveKey]


def test_levels_of_both_polarities_are_one_family(key_of: Maker) -> None:
    keys = [key_of(polarity, lux) for polarity in ("on", "off") for lux in (3.0, 0.076, 300.0)]
    (family,) = families_of(keys)
    assert family.axis == "level"
    assert [step.label for step in family.steps] == ["76 mlux", "3 lux", "300 lux"]
    assert [step.index for step in family.steps] == [0, 1, 2]
    assert {family.step_of(key) for key in keys} == set(family.steps)
    assert family.name == ""


def test_the_same_level_through_two_filters_is_two_steps(key_of: Maker) -> None:
    (family,) = families_of([key_of("on", 0.3, nd_od=3.0), key_of("on", 0.3), key_of("on", 3.0)])
    assert [step.label for step in family.steps] == ["300 mlux, OD 0", "300 mlux, OD 3", "3 lux"]


def test_pulse_widths_are_the_axis_where_there_are_more_of_them(key_of: Maker) -> None:
    keys = [key_of("on", lux, pulse_width_s=width) for lux in (0.1, 1.0) for width in (0.005, 0.02, 0.1)]
    families = families_of(keys)
    assert [family.axis for family in families] == ["width", "width"]
    assert [family.name for family in families] == ["1", "2"]
    assert [step.label for step in families[0].steps] == ["5 ms", "20 ms", "100 ms"]
    assert families[0].step_of(keys[0]) is not None
    assert families[1].step_of(keys[0]) is None


def test_waveforms_are_never_mixed(key_of: Maker) -> None:
    keys = [key_of("on", lux, waveform=waveform) for waveform in ("square", "reset_test") for lux in (1.0, 10.0)]
    assert len(families_of(keys)) == 2


def test_settings_are_an_axis_too(key_of: Maker) -> None:
    (family,) = families_of([key_of(settings=f"bias_diff_on={n}") for n in (0, 10, 20)])
    assert family.axis == "settings"
    assert [step.value for step in family.steps] == [0.0, 1.0, 2.0]


def test_no_keys_no_families() -> None:
    assert families_of([]) == ()
