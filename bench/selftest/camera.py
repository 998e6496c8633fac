"""The camera at first power-on."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.selftest.steps import Step
from drivers.interfaces import Recording, Waveform
from protocols.points import Roi

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.station import Station
    from drivers.interfaces import EventCamera

__all__ = ["biases", "dead_time", "health", "small_window", "window"]

_SIDE: Final = 16  # pixels of the window
_FLICKER_S: Final = 0.1
_CYCLES: Final = 10
_TEMPERATURE_C: Final = (5.0, 70.0)
_DEAD_TIME_OFFSETS: Final = (-20, 0, 100, 235)


def health(station: Station) -> Iterator[Step]:
    """Yield temperature and dead time as the camera measures them."""
    low, high = _TEMPERATURE_C
    celsius = station.camera.temperature_c()
    good = math.isnan(celsius) or low <= celsius <= high
    text = "it cannot measure it" if math.isnan(celsius) else f"{celsius:.1f} C"
    yield Step("camera", "temperature", "good" if good else "look", text, f"{low:g} to {high:g} C")


def biases(station: Station) -> Iterator[Step]:
    """Yield whether the biases are at the factory codes, take the ends of their ranges, and go back."""
    camera = station.camera
    start = camera.biases()
    away = {name: offset for name, offset in start.items() if offset}
    yield Step(
        "camera",
        "biases at the factory codes",
        "good" if not away else "bad",
        str(away or "all at offset 0"),
        "offset 0",
    )
    wrong = []
    for name, limits in camera.bias_limits.items():
        for offset in (int(limits.lowest), int(limits.highest)):
            camera.set_biases({name: offset})
            back = camera.biases()[name]
            if back != offset:
                wrong.append(f"{name} at {offset} reads {back}")
    camera.set_biases({})
    yield Step(
        "camera",
        "biases read back",
        "bad" if wrong else "good",
        "; ".join(wrong) or f"{len(start)} biases, both ends",
    )


def dead_time(station: Station) -> Iterator[Step]:
    """Yield the dead time against bias_refr: on an EVK4 a higher offset is a shorter dead time."""
    camera = station.camera
    limits = camera.bias_limits.get("bias_refr")
    if limits is None:
        return
    found = {}
    for offset in _DEAD_TIME_OFFSETS:
        if limits.lowest <= offset <= limits.highest:
            camera.set_biases({"bias_refr": offset})
            found[offset] = camera.refractory_s()
    camera.set_biases({})
    if any(math.isnan(value) for value in found.values()):
        yield Step("camera", "dead time", "look", "it cannot measure it")
        return
    falls = bool(np.all(np.diff(list(found.values())) < 0.0))
    text = ", ".join(f"{1e3 * value:.4g} ms at {offset:+d}" for offset, value in found.items())
    yield Step("camera", "dead time against bias_refr", "good" if falls else "bad", text, "falls with the offset")


def window(station: Station) -> Iterator[Step]:
    """Yield whether a flicker is seen by the pixels of a window and by no others, and whether anything is lost."""
    camera, light = station.camera, station.light
    roi = small_window(camera)
    camera.set_roi(roi)
    limits = light.limits
    low = math.sqrt(limits.lowest * limits.highest)
    high = min(4.0 * low, limits.highest)
    count = 2 * _CYCLES
    wave = Waveform(
        _FLICKER_S * np.arange(count, dtype=np.float64), np.tile([low, high], _CYCLES), _FLICKER_S * count
    )
    light.set_level(low)
    camera.start(Recording("self test: window", wave.duration_s))
    light.play(wave)
    camera.stop()
    events = np.concatenate([chunk.events for chunk in camera.chunks()])
    light.safe_state()
    camera.set_roi(Roi(0, 0, camera.width, camera.height))
    yield _inside(events, roi)
    answered = len(np.unique(events["x"].astype(np.int64) * camera.height + events["y"]))
    yield Step(
        "camera", "pixels that answer a flicker", "good" if answered > 0.9 * roi.pixels else "look",
        f"{answered} of {roi.pixels}, {len(events)} events", "nearly all",
    )  # fmt: skip
    quality = camera.quality()
    lost = quality.dropped_buffers + quality.overflows + quality.decode_errors + len(quality.gaps_s)
    yield Step(
        "camera", "nothing lost", "bad" if lost else "good",
        f"{quality.bytes_received} bytes, {quality.dropped_buffers} dropped, {quality.overflows} overflows, "
        f"{quality.decode_errors} decode errors, {len(quality.gaps_s)} gaps",
    )  # fmt: skip


def small_window(camera: EventCamera) -> Roi:
    """Return a few pixels in the middle: enough to see, and too few to lose anything."""
    return Roi(camera.width // 2, camera.height // 2, min(_SIDE, camera.width // 2), min(_SIDE, camera.height // 2))


def _inside(events: np.ndarray[tuple[int], np.dtype[np.void]], roi: Roi) -> Step:
    x, y = events["x"].astype(int) - roi.x, events["y"].astype(int) - roi.y
    outside = int(np.sum((x < 0) | (x >= roi.width) | (y < 0) | (y >= roi.height)))
    return Step("camera", "events within the window", "bad" if outside else "good", f"{outside} outside", "0 outside")
