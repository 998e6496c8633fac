"""The ready-made protocols: complete, within reach of a common bench, and able to re-arm the pixel."""

from __future__ import annotations

import math
from collections import Counter
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest

from protocols import library, load_protocol, parse_protocol, stimulus_of
from protocols.errors import InputError
from protocols.expected import reset_return
from protocols.files import parse_model
from protocols.points import Point, ResetTestTiming
from protocols.schema import Protocol

if TYPE_CHECKING:
    from pathlib import Path

LOWEST_LUX, HIGHEST_LUX = 20 * 0.0483, 15_000 * 0.0483  # a lamp of 20 to 15000 cd/m2 through a lens, without filter

POINTS = {
    "background_activity": 12,
    "bias_calibration": 387,
    "challenge": 36,
    "low_light_cutoff": 16,
    "off_family": 240,
    "on_family": 240,
    "paper_background": 30,
    "paper_reset_test": 600,
    "paper_square": 420,
    "pulse_width": 77,
    "quick_look": 64,
    "refined_quick_look": 16,
}


def protocol(name: str) -> Protocol:
    return load_protocol(name).protocol


def test_all_are_there() -> None:
    assert library.names() == tuple(sorted(POINTS))


@pytest.mark.parametrize("name", POINTS)
def test_number_of_points(name: str) -> None:
    points = protocol(name).expand()
    assert len(points) == POINTS[name]
    assert [p.index for p in points] == list(range(len(points)))
    assert len({p.seed for p in points}) == len(points)
    assert len(protocol(name).title) <= 70


@pytest.mark.parametrize("name", POINTS)
def test_each_filter_is_put_in_once(name: str) -> None:
    points = protocol(name).expand()
    assert sum(a.nd_od != b.nd_od for a, b in pairwise(points)) == len({p.nd_od for p in points}) - 1


@pytest.mark.parametrize("name", POINTS)
def test_every_level_is_within_reach(name: str) -> None:
    for point in protocol(name).expand():
        lux = stimulus_of(point).lux
        without_filter = lux[lux > 0] * 10**point.nd_od
        assert np.all((without_filter >= LOWEST_LUX) & (without_filter <= HIGHEST_LUX)), point


@pytest.mark.parametrize("name", POINTS)
def test_every_reset_rearms(name: str) -> None:
    made = protocol(name)
    for point in made.expand():
        if not isinstance(point.timing, ResetTestTiming):
            continue
        expected = made.expected_at(point)
        up = point.timing.reset_direction == "up"
        needed = expected.theta_off if up else expected.theta_on
        assert needed is not None
        assert expected.dark_light_lux is not None
        # the published study resets by 0.41 against 0.3; ours allow for noise of 0.05 rms
        margin = 1.2 if name.startswith("paper") else 1.3
        assert reset_return(point, expected.dark_light_lux) >= margin * needed, point


@pytest.mark.parametrize("name", ["quick_look", "on_family", "off_family", "pulse_width"])
def test_gaps_outlast_refractory_period_and_settling(name: str) -> None:
    for point in protocol(name).expand():
        if isinstance(point.timing, ResetTestTiming):
            assert point.settings.refractory_s is not None
            assert point.settings.bandwidth_hz is not None
            settled_s = point.settings.refractory_s + 5 / (2 * math.pi * point.settings.bandwidth_hz)
            assert min(point.timing.gap_s, point.timing.reset_s) >= settled_s


def test_quick_look() -> None:
    points = protocol("quick_look").expand()
    assert Counter((p.waveform, p.polarity) for p in points) == {
        ("reset_test", "on"): 30,
        ("reset_test", "off"): 30,
        ("constant", "both"): 4,
    }
    assert {p.roi.pixels for p in points} == {256}
    assert {p.baseline_lux: p.nd_od for p in points if p.waveform == "constant"} == {0.1: 3, 1: 0, 10: 0, 100: 0}
    assert len({p.settings for p in points}) == 1
    assert 300 < protocol("quick_look").estimate().duration_s < 420


@pytest.mark.parametrize(("name", "polarity"), [("on_family", "on"), ("off_family", "off")])
def test_families_span_the_expected_threshold(name: str, polarity: str) -> None:
    made = protocol(name)
    points = made.expand()
    levels: dict[float, list[Point]] = {}
    for point in points:
        assert point.polarity == polarity
        assert point.pulses == 100
        levels.setdefault(point.baseline_lux, []).append(point)
    assert sorted(levels)[:4] == [0.076, 0.1, 0.152, 0.304]
    assert (len(levels), max(levels)) == (8, 300)
    for lux, at_level in levels.items():
        assert len(at_level) == 30
        changes = sorted(_change(p, made) for p in at_level)
        contrasts = sorted(p.log_contrast for p in at_level)
        assert contrasts[-1] / contrasts[0] == pytest.approx(2.0 / 0.3)
        assert changes[0] < 0.30 < changes[-1]
        assert {p.nd_od for p in at_level} == {3.0 if lux < 0.9 else 0.0}
    settings = points[0].settings
    other, tested = (
        (settings.theta_off, settings.theta_on) if polarity == "on" else (settings.theta_on, settings.theta_off)
    )
    assert (other, tested) == (0.25, 0.30)


def _change(point: Point, made: Protocol) -> float:
    """Return by how much the test pulse changes the log photocurrent, dark light included."""
    dark = made.expected_at(point).dark_light_lux or 0.0
    sign = 1 if point.polarity == "on" else -1
    step = point.baseline_lux * math.exp(sign * point.log_contrast)
    return abs(math.log((step + dark) / (point.baseline_lux + dark)))


def test_the_published_study() -> None:
    square, pairs = protocol("paper_square").expand(), protocol("paper_reset_test").expand()
    for points in (square, pairs):
        contrasts = sorted({p.log_contrast for p in points})
        assert len(contrasts) == 30
        assert [math.expm1(contrasts[0]), math.expm1(contrasts[-1])] == pytest.approx([0.01, 0.7])
        assert {p.settings.bandwidth_hz for p in points} == {2000, 200, 50}
        assert {p.settings.refractory_s for p in points} == {0.0001, 0.010}
        thresholds = {(p.settings.theta_on, p.settings.theta_off) for p in points}
        assert thresholds == {(0.3, 0.3), (0.3, 0.27), (0.3, 0.33), (0.27, 0.3), (0.33, 0.3)}
    timing = pairs[0].timing
    assert isinstance(timing, ResetTestTiming)
    assert (timing.reset_s, timing.test_s, timing.window_s) == (0.4, 0.2, 0.2)
    assert math.expm1(timing.reset_log_contrast) == pytest.approx(0.5)


@pytest.mark.parametrize("name", POINTS)
def test_resolved_is_the_same_protocol_with_everything_written_out(name: str) -> None:
    made = protocol(name)
    data = made.resolved()
    again = Protocol.model_validate(data)
    assert again.expand() == made.expand()
    assert again.resolved() == data
    for measurement in data["measurements"]:
        assert set(measurement["settle"]) == {"light_s", "filter_s", "bias_s"}
        assert None not in measurement["settle"].values()
        assert measurement["seed"] == made.seed
        assert isinstance(measurement["sweep"]["illuminance_lux"], list)


def test_resolved_can_be_written_as_yaml() -> None:
    import yaml

    made = protocol("quick_look")
    text = yaml.safe_dump(made.resolved(), sort_keys=False)
    assert parse_model(text, Protocol, "run.yaml").expand() == made.expand()


def test_loading_by_name_and_by_path(tmp_path: Path) -> None:
    loaded = load_protocol("quick_look")
    assert (loaded.source, loaded.text) == ("quick_look", library.text("quick_look"))
    copy = tmp_path / "mine.yaml"
    copy.write_text(loaded.text, encoding="utf-8")
    by_path = load_protocol(copy)
    assert (by_path.source, by_path.protocol) == (str(copy), loaded.protocol)
    assert parse_protocol(loaded.text, "again").protocol == loaded.protocol


def test_a_name_that_is_not_there() -> None:
    with pytest.raises(InputError, match="did you mean 'quick_look'"):
        load_protocol("quicklook")
    with pytest.raises(InputError, match="ready-made are background_activity, "):
        load_protocol("xyz")
    with pytest.raises(InputError, match="no ready-made protocol 'xyz'"):
        library.text("xyz")
