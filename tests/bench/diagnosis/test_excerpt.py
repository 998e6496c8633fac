"""Of long recordings the beginnings are looked at: whole pulses, and what is dim as a whole."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.diagnosis.expected.catalogue import candidates
from bench.diagnosis.recorded.excerpt import beginnings, middles, shortened_text
from bench.diagnosis.recorded.recording import Frame, Recording
from bench.diagnosis.recorded.summary import summarise
from bench.diagnosis.session import open_session
from bench.diagnosis.views.registry import views
from drivers.events.types import EVENT_DTYPE
from protocols.points import Roi
from sim_backend.pixel import PixelModel

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.store.data import PointData


def _of(point: Callable[..., Any], events: int, index: int = 0, contrast: float = 0.4, **changes: Any) -> PointData:
    made: PointData = point(index, contrast, **{"periods": 40, **changes})
    return replace(made, n_events=events)


def test_a_run_of_few_events_is_looked_at_as_a_whole(point: Callable[..., Any]) -> None:
    points = [_of(point, 300, 0), _of(point, 700, 1)]
    assert beginnings(points, 1000) == points
    assert shortened_text(points, points) == ""


def test_a_long_recording_ends_behind_a_pulse_with_its_share_of_the_events(point: Callable[..., Any]) -> None:
    points = [_of(point, 4000, 0), _of(point, 4000, 1)]
    found = beginnings(points, 4000)
    for whole, cut in zip(points, found, strict=True):
        assert cut.duration_s == cut.until_s
        assert cut.duration_s == pytest.approx(0.5 * whole.duration_s, abs=0.1)  # a period
        assert cut.pulse_stop_s[-1] == pytest.approx(cut.duration_s)
        assert cut.stimulus_t_s[-1] < cut.duration_s
        ends = len(cut.pulse_start_s)
        for name in ("pulse_start_s", "pulse_stop_s", "pulse_kind", "pulse_valid", "pulse_log_contrast"):
            np.testing.assert_array_equal(getattr(cut, name), getattr(whole, name)[:ends])
        np.testing.assert_array_equal(cut.stimulus_lux, whole.stimulus_lux[: len(cut.stimulus_lux)])
    assert shortened_text(points, found).startswith("the beginning of 2 of 2 recordings: ")


def test_however_many_events_there_are_some_pulses_of_each_kind_and_contrast_are_left(
    point: Callable[..., Any],
) -> None:
    mixed = _of(point, 10**9)
    contrast = np.where(np.arange(80) % 8 < 6, 0.4, 0.7)  # one in four has the other contrast
    mixed = replace(mixed, pulse_log_contrast=contrast)
    (cut,) = beginnings([mixed], 1000)
    for kind in (0, 1):
        for value in (0.4, 0.7):
            assert np.sum((cut.pulse_kind == kind) & (cut.pulse_log_contrast == value)) >= 8
    assert np.sum(cut.pulse_log_contrast == 0.7) == 16  # and no more than that


def test_what_is_dim_stays_whole_and_leaves_the_others_more(point: Callable[..., Any]) -> None:
    dim = [_of(point, 100, i, 0.0, duration_s=100.0) for i in range(4)]
    bright = [_of(point, 10_000, 10 + i, 0.4 + 0.1 * i, periods=200) for i in range(2)]
    found = beginnings([*dim, *bright], 8400)
    assert found[:4] == dim
    for whole, cut in zip(bright, found[4:], strict=True):
        assert cut.duration_s == pytest.approx(0.4 * whole.duration_s, abs=0.2)


def test_recordings_of_which_the_same_was_asked_stay_equally_long(point: Callable[..., Any]) -> None:
    same = [_of(point, n, i, lux=lux) for i, (n, lux) in enumerate([(500, 1.0), (9000, 10.0), (3000, 100.0)])]
    found = beginnings(same, 5000)
    assert len({p.duration_s for p in found}) == 1
    assert found[0].duration_s < same[0].duration_s


def test_constant_light_has_no_pulses_to_end_behind(point: Callable[..., Any]) -> None:
    constant = _of(point, 50_000, 0, 0.0, duration_s=60.0)
    assert beginnings([constant], 10_000)[0].duration_s == pytest.approx(12.0)
    assert beginnings([constant], 10)[0].duration_s == 2.0


def test_gaps_and_triggers_behind_the_end_are_left_out(point: Callable[..., Any]) -> None:
    asked = replace(
        _of(point, 10_000, 0, 0.0, duration_s=10.0),
        gaps_s=np.array([[0.5, 0.6], [1.9, 2.9], [3.0, 3.1]]),
        triggers_t_us=np.array([100_000, 3_000_000]),
        triggers_p=np.array([1, 0], np.uint8),
    )
    (cut,) = beginnings([asked], 2500)
    np.testing.assert_allclose(cut.gaps_s, [[0.5, 0.6], [1.9, 2.5]])
    assert cut.triggers_t_us.tolist() == [100_000]


@pytest.mark.parametrize("contrast", [0.0, 0.5])
def test_later_events_say_nothing(point: Callable[..., Any], recorded: Callable[..., Any], contrast: float) -> None:
    rng = np.random.default_rng(5)
    t = np.sort(rng.integers(0, 4_000_000, 3000))
    events = np.stack([t, rng.integers(0, 8, 3000), rng.integers(0, 8, 3000), rng.integers(0, 2, 3000)], axis=1)
    taken = recorded(point(0, contrast, periods=40, duration_s=4.05), [tuple(e) for e in events])
    (cut,) = beginnings([taken], 1500)
    until = int(np.sum(taken.stored["t"] <= cut.until_s * 1e6))
    assert until < 2000
    seen = [
        summarise(Recording(Frame(cut), [np.asarray(stored, EVENT_DTYPE)]), views())
        for stored in (taken.stored, taken.stored[:until])
    ]
    np.testing.assert_array_equal(seen[0].top, seen[1].top)
    np.testing.assert_array_equal(seen[0].bottom, seen[1].bottom)


@pytest.mark.parametrize(
    ("size", "looked_at"),
    [
        ((64, 64), (64, 64)),
        ((100, 100), (64, 64)),
        ((1000, 4), (1000, 4)),
        ((2000, 4), (1024, 4)),
        ((3, 5000), (3, 1365)),
    ],
)
def test_of_a_large_window_the_middle_is_looked_at(
    point: Callable[..., Any], size: tuple[int, int], looked_at: tuple[int, int]
) -> None:
    asked = _of(
        point, 1000, roi=Roi(10, 20, *size), masked=np.array([[10, 20], [10 + size[0] // 2, 20 + size[1] // 2]])
    )
    (found,) = middles([asked])
    roi = found.roi
    assert (roi.width, roi.height) == looked_at
    assert abs((roi.x - 10) - (10 + size[0] - roi.x - roi.width)) <= 1
    assert abs((roi.y - 20) - (20 + size[1] - roi.y - roi.height)) <= 1
    assert len(found.masked) == (2 if size == looked_at else 1)
    assert bool(shortened_text([asked], [found])) == (size != looked_at)


def test_limits_of_the_readout_are_not_looked_for_in_part_of_a_window(point: Callable[..., Any]) -> None:
    asked = _of(point, 1000, roi=Roi(10, 20, 100, 100))
    inside, outside = (
        {e.id for e in candidates(PixelModel(), points)} for points in (middles([asked]), [asked])
    )  # fmt: skip
    assert outside - inside == {"readout_saturation", "event_rate_limit"}


def test_a_session_looks_at_the_beginnings_and_says_so_unless_all_is_wanted(
    point: Callable[..., Any], run_of: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bench.diagnosis.session.ENOUGH_EVENTS", 2000)
    run = run_of([point(0, 0.8, periods=60, roi=Roi(40, 30, 8, 8))], PixelModel(noise_rms=0.04), 3)
    with open_session([run]) as session:
        assert session.shortened.startswith("the beginning of 1 of 1 recordings: ")
        assert session.problem.points[0].duration_s < 3.0
    with open_session([run], whole=True) as session:
        assert session.shortened == ""
        assert session.problem.points[0].duration_s == pytest.approx(6.05)
