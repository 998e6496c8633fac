"""Hand-made analyses and runs, so that a report can be drawn without measuring anything."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pytest

from bench.analysis.results import Analysis, BackgroundRow, CurveKey, Estimate, PixelMap, ResponseRow, SCurve
from bench.store.data import PointData, RunHeader, Sensor
from drivers.events.types import EVENT_DTYPE
from protocols.points import Roi

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import numpy.typing as npt

ROI = Roi(632, 352, 16, 12)
LEVELS = (0.076, 0.152, 0.304, 1.0, 3.0, 30.0, 100.0, 300.0)
DARK_LUX = 0.146
THETA = {"on": 0.35, "off": 0.30}
PULSES = 50


@dataclass(frozen=True, slots=True)
class FakePoint(PointData):
    """A point whose events lie in memory."""

    stored: npt.NDArray[np.void] | None = None

    def events(self, chunk: int = 1_000_000) -> Iterator[npt.NDArray[np.void]]:
        """Yield the stored events, `chunk` at a time."""
        stored = np.zeros(0, EVENT_DTYPE) if self.stored is None else self.stored
        for start in range(0, stored.size, chunk):
            yield stored[start : start + chunk]


@dataclass(frozen=True, slots=True)
class FakeRun:
    """A run in memory."""

    header: RunHeader
    taken: tuple[FakePoint, ...]

    def points(self) -> Iterator[PointData]:
        """Yield the points."""
        yield from self.taken


def normal_cdf(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.array([0.5 * (1.0 + math.erf(v / math.sqrt(2.0))) for v in x])


def around(value: float, half_width: float, unit: str = "ln", note: str = "") -> Estimate:
    return Estimate(value, value - half_width, value + half_width, unit, note)


def nothing(unit: str, note: str) -> Estimate:
    return Estimate(math.nan, math.nan, math.nan, unit, note)


def make_key(polarity: Literal["on", "off"] = "on", lux: float = 3.0, **changed: Any) -> CurveKey:
    values: dict[str, Any] = {
        "waveform": "reset_test", "polarity": polarity, "baseline_lux": lux, "nd_od": 0.0, "pulse_width_s": 0.02,
        "settings": "",
    }  # fmt: skip
    return CurveKey(**{**values, **changed})


def contrast_needed(theta: float, lux: float) -> float:
    """Log contrast that an ON event needs above a dark light."""
    return math.log1p((1.0 + DARK_LUX / lux) * math.expm1(theta))


def make_row(key: CurveKey, point: int, contrast: float, probability: float, **changed: Any) -> ResponseRow:
    pixels, width = ROI.pixels, 0.03
    responses = round(probability * pixels * PULSES)
    edges = np.concatenate(([0.0], 50e-6 * 10.0 ** (np.arange(0, 58) / 20.0), [0.04]))
    centre = 0.002 + 0.004 / (1.0 + key.baseline_lux)
    middles = np.sqrt(np.maximum(edges[:-1], 1e-5) * edges[1:])
    weight = np.exp(-0.5 * (np.log(middles / centre) / 0.35) ** 2)
    values: dict[str, Any] = {
        "point": point, "key": key, "log_contrast": contrast, "pulses": PULSES, "pixels": pixels,
        "responses": responses, "probability": responses / (pixels * PULSES),
        "low": max(0.0, probability - width), "high": min(1.0, probability + width),
        "events_per_pulse": 1.1 * probability, "answered_resets": 0.93 if key.baseline_lux < 0.1 else 0.995,
        "per_pixel": np.full(pixels, responses // pixels), "latency_edges_s": edges,
        "latency_counts": np.round(responses * weight / weight.sum()).astype(np.int64),
        "latency_median_s": centre * (1.0 + 0.5 / (1.0 + contrast)) if responses else math.nan,
        "latency_iqr_s": 0.3 * centre,
    }  # fmt: skip
    return ResponseRow(**{**values, **changed})


def make_curve(key: CurveKey, contrasts: npt.NDArray[np.float64], **changed: Any) -> SCurve:
    needed = contrast_needed(THETA[key.polarity], key.baseline_lux)
    sigma, floor, plateau = 0.13 * needed, 0.02, 0.985
    probability = floor + (plateau - floor) * normal_cdf((contrasts - 0.88 * needed) / sigma)
    fit = np.linspace(contrasts.min(), contrasts.max(), 201) if contrasts.size else np.zeros(0)
    values: dict[str, Any] = {
        "key": key, "log_contrast": contrasts, "probability": probability,
        "low": np.maximum(0.0, probability - 0.03), "high": np.minimum(1.0, probability + 0.03),
        "half": around(0.88 * needed, 0.01), "intercept": around(1.18 * needed, 0.03),
        "floor": around(floor, 0.008, "1"), "plateau": around(plateau, 0.01, "1"), "quantile": 0.99,
        "theta": around(needed, 0.008), "noise_rms": around(0.042, 0.004), "fit_contrast": fit,
        "fit_probability": floor + (plateau - floor) * normal_cdf((fit - 0.88 * needed) / sigma),
        "answered_resets": 0.93 if key.baseline_lux < 0.1 else 0.995, "limited_by": None, "warnings": (),
    }  # fmt: skip
    return SCurve(**{**values, **changed})


def make_background(point: int, polarity: Literal["on", "off"], lux: float, events: int) -> BackgroundRow:
    seconds = ROI.pixels * 10.0
    high = 3.0 / seconds if not events else (events + 1.7 * math.sqrt(events)) / seconds
    low = max(0.0, (events - 1.6 * math.sqrt(events)) / seconds)
    note = "" if events else "no events: the upper end is an upper limit"
    return BackgroundRow(
        point, polarity, lux, 0.0, events, seconds, Estimate(events / seconds, low, high, "Hz", note)
    )


def make_map(key: CurveKey, spread: float, seed: int) -> PixelMap:
    half = np.random.default_rng(seed).normal(0.31, spread, (ROI.height, ROI.width))
    half[2, 3] = np.nan
    return PixelMap(key, half, np.full_like(half, 0.01))


def make_analysis(
    levels: Sequence[float] = LEVELS, contrasts: int = 30, polarities: Sequence[Literal["on", "off"]] = ("on", "off")
) -> Analysis:
    """Return what analysis finds in a family of reset/test S-curves with background points."""
    curves: list[SCurve] = []
    rows: list[ResponseRow] = []
    background: list[BackgroundRow] = []
    for polarity in polarities:
        for lux in levels:
            key = make_key(polarity, lux, nd_od=3.0 if lux < 0.2 else 0.0)
            needed = contrast_needed(THETA[polarity], lux)
            curve = make_curve(key, np.linspace(0.3 * needed, 2.0 * needed, contrasts), warnings=_warnings(lux))
            curves.append(curve)
            for contrast, probability in zip(curve.log_contrast, curve.probability, strict=True):
                rows.append(make_row(key, len(rows), float(contrast), float(probability)))
    for lux in levels:
        for polarity, scale in (("on", 400), ("off", 60)):
            events = int(scale / (1.0 + 3.0 * lux))
            background.append(make_background(len(rows) + len(background) // 2, polarity, lux, events))
    maps = [make_map(make_key(polarity, lux), 0.025, 5) for polarity in polarities for lux in levels[-2:]]
    events_of_pixels = np.random.default_rng(3).poisson(800, (ROI.height, ROI.width))
    return Analysis(
        "2026-11-20T21-03-11Z-families", "ON and OFF families at eight light levels", tuple(rows), tuple(curves),
        tuple(background), tuple(maps), events_of_pixels, (ROI.x, ROI.y),
        ("point 12: 3 pulses were left out, because data are missing there",),
    )  # fmt: skip


def _warnings(lux: float) -> tuple[str, ...]:
    return ("93.0 % of resets were answered, under 95 %",) if lux < 0.1 else ()


def constant_analysis() -> Analysis:
    """Return what analysis finds in a run that has one constant point."""
    rows = (make_background(0, "on", 3.0, 41), make_background(0, "off", 3.0, 0))
    events = np.zeros((ROI.height, ROI.width), np.int64)
    events[3, 4] = 41
    return Analysis("constant", "", (), (), rows, (), events, (ROI.x, ROI.y), ())


def make_header(title: str = "ON and OFF families at eight light levels", **everything: Any) -> RunHeader:
    sensor = Sensor("IMX636", 1280, 720, 4.86e-6, 0.6)
    content = {"software": {"evs-bench": "0.1.0", "python": "3.12.3"}, **everything}
    return RunHeader("2026-11-20T21-03-11Z-families", sensor, ROI, title, "2026-11-20T21:03:11Z", content)


def some_events(
    times_s: npt.NDArray[np.floating[Any]], polarity: int, rng: np.random.Generator
) -> npt.NDArray[np.void]:
    """Return one event of a few pixels after each of `times_s`."""
    events = np.zeros(times_s.size * 8, EVENT_DTYPE)
    events["t"] = np.round(1e6 * np.repeat(times_s, 8)) + rng.integers(1500, 5000, events.size)
    events["x"] = ROI.x + np.tile(np.arange(8), times_s.size)
    events["y"] = ROI.y + 3
    events["p"] = polarity
    return events


def make_point(index: int = 0, lux: float = 3.0, contrast: float = 0.4, **changed: Any) -> FakePoint:
    """Return a reset/test point: gap, reset, gap, test; 20 periods of 0.28 s."""
    begin = 0.28 * np.arange(20)
    edges = np.sort(np.concatenate((begin, begin + 0.1, begin + 0.14, begin + 0.24)))
    light = np.tile([lux, lux * math.exp(0.6), lux, lux * math.exp(contrast)], 20)
    rng = np.random.default_rng(index)
    stored = np.concatenate((
        some_events(begin + 0.1, 1, rng), some_events(begin + 0.14, 0, rng),
        some_events(begin[rng.random(20) < 0.85] + 0.24, 1, rng),
    ))  # fmt: skip
    values: dict[str, Any] = {
        "path": Path("nowhere.h5"), "index": index, "waveform": "reset_test", "polarity": "on", "baseline_lux": lux,
        "log_contrast": contrast, "duration_s": 5.6, "nd_od": 0.0, "refractory_s": 0.01, "temperature_c": 31.5,
        "roi": ROI, "n_events": stored.size, "stimulus_t_s": edges, "stimulus_lux": light,
        "pulse_start_s": begin + 0.24, "pulse_stop_s": begin + 0.28, "pulse_kind": np.zeros(20, np.uint8),
        "pulse_valid": np.ones(20, np.bool_), "pulse_log_contrast": np.full(20, contrast),
        "triggers_t_us": np.zeros(0, np.int64), "triggers_p": np.zeros(0, np.uint8),
        "masked": np.zeros((0, 2), np.uint16), "gaps_s": np.zeros((0, 2)), "bias": {}, "quality": {},
        "attributes": {}, "stored": np.sort(stored, order="t"),
    }  # fmt: skip
    return FakePoint(**{**values, **changed})


def make_constant_point(index: int = 0, lux: float = 3.0) -> FakePoint:
    """Return a constant point of 10 s with 41 ON events of one pixel."""
    stored = np.zeros(41, EVENT_DTYPE)
    stored["t"], stored["x"], stored["y"], stored["p"] = 200_000 * np.arange(1, 42), ROI.x + 4, ROI.y + 3, 1
    none = np.zeros(0)
    return make_point(
        index, lux, 0.0, waveform="constant", polarity="both", duration_s=10.0, n_events=41,
        stimulus_t_s=np.zeros(1), stimulus_lux=np.full(1, lux), pulse_start_s=none, pulse_stop_s=none,
        pulse_kind=np.zeros(0, np.uint8), pulse_valid=np.zeros(0, np.bool_), pulse_log_contrast=none, stored=stored,
    )  # fmt: skip


def make_run(
    title: str = "ON and OFF families at eight light levels", points: int = 64, **everything: Any
) -> FakeRun:
    taken = [make_point(i, LEVELS[i % len(LEVELS)], 0.2 + 0.02 * (i // len(LEVELS))) for i in range(points)]
    return FakeRun(make_header(title, **everything), tuple(taken))


def make_constant_run(title: str, **everything: Any) -> FakeRun:
    return FakeRun(make_header(title, **everything), (make_constant_point(),))


@pytest.fixture(scope="session")
def family_analysis() -> Analysis:
    return make_analysis()


@pytest.fixture(scope="session")
def constant() -> Analysis:
    return constant_analysis()


@pytest.fixture(scope="session")
def run_of() -> Callable[..., FakeRun]:
    return make_run


@pytest.fixture(scope="session")
def constant_run_of() -> Callable[..., FakeRun]:
    return make_constant_run


@pytest.fixture(scope="session")
def key_of() -> Callable[..., CurveKey]:
    return make_key


@pytest.fixture(scope="session")
def curve_of() -> Callable[..., SCurve]:
    return make_curve


@pytest.fixture(scope="session")
def row_of() -> Callable[..., ResponseRow]:
    return make_row


@pytest.fixture(scope="session")
def background_of() -> Callable[..., BackgroundRow]:
    return make_background


@pytest.fixture(scope="session")
def unknown() -> Callable[..., Estimate]:
    return nothing
