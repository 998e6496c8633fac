"""Light source and filter wheel at first power-on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from bench.selftest.camera import small_window
from bench.selftest.steps import Step
from drivers.events.types import empty_triggers
from drivers.interfaces import Recording, Waveform

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.station import Station

__all__ = ["edges", "filters", "levels"]

_CLOSE: Final = 0.01  # relative, of a level that is read back
_CYCLES: Final = 10
_BRIGHT_S, _DARK_S = 0.2, 0.5  # unequal, so that a swapped polarity shows; slow enough for a source timed by the host
_JITTER_S: Final = {"device": 20e-6, "host": 5e-3}


def levels(station: Station) -> Iterator[Step]:
    """Yield whether the source is dark, and reads back its lowest and its highest level."""
    light, clock = station.light, station.clock
    yield Step(
        "light", "dark after connecting", "good" if light.level() == 0.0 else "bad", f"level {light.level():g}", "0"
    )
    for name, level in (("lowest", light.limits.lowest), ("highest", light.limits.highest)):
        begin = clock.now()
        light.set_level(level)
        took, back = clock.now() - begin, light.level()
        good = abs(back - level) <= max(_CLOSE * level, light.level_step)
        yield Step(
            "light", f"{name} level", "good" if good else "bad", f"reads {back:g} after {1e3 * took:.3g} ms",
            f"{level:g} {light.limits.unit}",
        )  # fmt: skip
    light.safe_state()
    yield Step("light", "dark again", "good" if light.level() == 0.0 else "bad", f"level {light.level():g}", "0")


def edges(station: Station) -> Iterator[Step]:
    """Yield how the edges of a square wave of unequal duty come, and what the camera's trigger input sees of them."""
    light, camera = station.light, station.camera
    low, high = _two_levels(station)
    period = _BRIGHT_S + _DARK_S
    t_s = np.concatenate([[0.0], np.ravel([[_DARK_S + i * period, (i + 1) * period] for i in range(_CYCLES)])])
    level = np.concatenate([[low], np.tile([high, low], _CYCLES)])
    wave = Waveform(t_s, level, float(t_s[-1]) + _DARK_S)
    light.set_level(low)
    camera.set_roi(small_window(camera))
    camera.start(Recording("self test: edges", wave.duration_s))
    played = light.play(wave)
    camera.stop()
    triggers = np.concatenate([chunk.triggers for chunk in camera.chunks()] or [empty_triggers()])
    light.safe_state()
    late = played.t_s[1:] - t_s[1:]
    yield Step(
        "light", "edges come when they should", "good" if np.ptp(late) < _JITTER_S[light.timing] else "look",
        f"{1e3 * late.mean():.3g} ms late, spread {1e3 * np.ptp(late):.3g} ms, timed by the {light.timing}",
        f"spread below {1e3 * _JITTER_S[light.timing]:g} ms",
    )  # fmt: skip
    if played.t_settled_s is not None and played.t_written_s is not None:
        took = played.t_settled_s[1:] - played.t_written_s[1:]
        yield Step(
            "light",
            "from a request to settled light",
            "look",
            f"{1e3 * np.median(took):.3g} ms, at most {1e3 * took.max():.3g}",
        )
    yield _triggers(triggers, played.t_s[1:])


def _triggers(
    triggers: np.ndarray[tuple[int], np.dtype[np.void]], edges_s: np.ndarray[tuple[int], np.dtype[np.float64]]
) -> Step:
    what, expected = "trigger input", f"{len(edges_s)} edges, rising with the light"
    if not len(triggers):
        return Step("camera", what, "look", "no trigger edges: events have to place the stimulus", expected)
    if len(triggers) != len(edges_s):
        return Step("camera", what, "bad", f"{len(triggers)} edges", expected)
    seen_s = triggers["t"] / 1e6
    jitter = float(np.std(np.diff(seen_s) - np.diff(edges_s)))
    rising = triggers["p"][0] == 1
    return Step(
        "camera", what, "good" if rising else "look",
        f"{len(triggers)} edges, {'rising' if rising else 'falling (inverted)'} with the light, "
        f"jitter {1e6 * jitter:.3g} us",
        expected,
    )  # fmt: skip


def filters(station: Station) -> Iterator[Step]:
    """Yield whether each filter arrives, and in what time."""
    wheel, clock = station.wheel, station.clock
    for one in (*wheel.filters[1:], wheel.filters[0]):
        begin = clock.now()
        wheel.select(one.name)
        took, there = clock.now() - begin, wheel.selected()
        yield Step(
            "wheel",
            f"filter {one.name}",
            "good" if there == one.name else "bad",
            f"{there} is in, {took:.3g} s",
            one.name,
        )


def _two_levels(station: Station) -> tuple[float, float]:
    """Return two levels a factor e apart, in the middle of the range on a log scale."""
    limits = station.light.limits
    middle = float(np.sqrt(limits.lowest * limits.highest))
    return max(middle / np.e**0.5, limits.lowest), min(middle * np.e**0.5, limits.highest)
