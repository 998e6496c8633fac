"""A characterization as it was saved, as far as its figures and its section of the report show it."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench.analysis.results import Estimate
from bench.characterize.saving import FORMAT
from bench.report.wording import duration_label
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import numpy.typing as npt

    from bench.analysis.results import ResponsePolarity

__all__ = [
    "JSON_FILE",
    "SavedCharacterization",
    "SavedFamily",
    "SavedLevel",
    "SavedLine",
    "SavedMismatch",
    "SavedNoise",
    "SavedTest",
    "read_characterization",
]

JSON_FILE: Final = "characterization.json"
_WAVEFORMS: Final = {"square": "square wave", "reset_test": "reset and test pulses"}


@dataclass(frozen=True, slots=True)
class SavedLevel:
    """One light level of a family."""

    baseline_lux: float
    nd_od: float
    half: Estimate  #: ln
    intercept: Estimate  #: ln
    theta: Estimate | None  #: ln, dark light accounted for; None without a fit
    dark_lux: Estimate
    noise_rms: float  #: ln; NaN without a fit
    corner_hz: float  #: of the photoreceptor; NaN where it is not seen, or without a fit


@dataclass(frozen=True, slots=True)
class SavedLine:
    """A straight line of Weber contrast against 1/E."""

    theta: Estimate  #: ln
    dark_lux: Estimate


@dataclass(frozen=True, slots=True)
class SavedTest:
    """The test whether one threshold holds at all levels."""

    chi2: float
    dof: int
    p_value: float

    @property
    def holds(self) -> bool:
        """Whether the data agree with one threshold, at 1 %."""
        return self.p_value > 0.01


@dataclass(frozen=True, slots=True)
class SavedFamily:
    """A family of S-curves of one polarity."""

    run: str
    polarity: ResponsePolarity
    waveform: str
    pulse_width_s: float  #: NaN where it is not known
    settings: str
    levels: tuple[SavedLevel, ...]
    by_intercept: SavedLine | None
    by_half: SavedLine | None
    fit: dict[str, Estimate]  #: the fitted numbers by name; empty without a fit
    chi2_per_dof: float  #: of the fit; NaN without one
    why_no_fit: str
    test: SavedTest | None
    filter_od: Estimate | None  #: by which filters are denser than stated; None where that was not fitted
    theta: Estimate  #: ln
    dark_lux: Estimate
    warnings: tuple[str, ...]

    @property
    def kind(self) -> str:
        """What families have in common that are shown together: all but the polarity."""
        width = duration_label(self.pulse_width_s) if math.isfinite(self.pulse_width_s) else ""
        name = _WAVEFORMS.get(self.waveform, self.waveform)
        return ", ".join(text for text in (f"{name} of {width}" if width else name, self.settings) if text)


@dataclass(frozen=True, slots=True)
class SavedNoise:
    """Background activity in one constant light."""

    baseline_lux: float
    nd_od: float
    settings: str
    on: Estimate  #: Hz per pixel
    off: Estimate
    random_hz: float
    noise_rms: float  #: ln; NaN where it cannot be told
    corner_hz: float  #: that this assumes; NaN where it cannot be told


@dataclass(frozen=True, slots=True)
class SavedMismatch:
    """How the thresholds of one polarity differ from pixel to pixel."""

    polarity: ResponsePolarity
    sigma: Estimate  #: ln, without the counting errors
    baseline_lux: float
    theta: npt.NDArray[np.float64] = field(repr=False)  #: (height, width) ln; NaN where unknown
    error: npt.NDArray[np.float64] = field(repr=False)  #: (height, width) counting error of each, ln


@dataclass(frozen=True, slots=True)
class SavedCharacterization:
    """All that is shown of a characterization."""

    runs: tuple[str, ...]
    families: tuple[SavedFamily, ...]
    dark: Mapping[str, Any] | None  #: as saved
    cutoffs: tuple[Mapping[str, Any], ...]  #: as saved
    noise: tuple[SavedNoise, ...]
    mismatch: tuple[SavedMismatch, ...]
    hot_pixels: tuple[Mapping[str, Any], ...]  #: as saved
    warnings: tuple[str, ...]

    def groups(self) -> tuple[tuple[str, tuple[SavedFamily, ...]], ...]:
        """Return the families that are shown together, and what to call them where there are several groups."""
        found: dict[tuple[str, str], list[SavedFamily]] = {}
        for family in self.families:
            found.setdefault((family.run, family.kind), []).append(family)
        several_runs = len({run for run, _ in found}) > 1
        titles = [f"{kind}, {run}" if several_runs else kind for run, kind in found]
        return tuple((t, tuple(sorted(fs, key=_on_first))) for t, fs in zip(titles, found.values(), strict=True))


def _on_first(family: SavedFamily) -> bool:
    return family.polarity != "on"


def read_characterization(folder: Path) -> SavedCharacterization:
    """Return the characterization in `folder`; numbers that were not finite are NaN.

    Raises
    ------
    InputError
        A file cannot be read, or is none of a characterization.
    """
    path = folder / JSON_FILE
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["format"] != FORMAT:
            raise InputError(f"{path}: is of format {content['format']!r}; expected {FORMAT!r}")
        return _characterization(content, folder)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(
            f"{path}: cannot be read as a characterization ({type(error).__name__}: {error}); expected what "
            "'evs-bench characterize' wrote, make it again"
        ) from None


def _characterization(content: Mapping[str, Any], folder: Path) -> SavedCharacterization:
    dark = content["dark_light"]
    if dark is not None:
        dark = {**dark, "lux": _estimate(dark["lux"]), "current_fa": _maybe(dark["current_fa"])}
    cutoffs = [
        {**c, "measured_lux": _estimate(c["measured_lux"]), "predicted_lux": _maybe(c["predicted_lux"])}
        for c in content["cutoffs"]
    ]
    return SavedCharacterization(
        runs=tuple(content["runs"]),
        families=tuple(_family(f) for f in content["families"]),
        dark=dark,
        cutoffs=tuple(cutoffs),
        noise=tuple(_noise(n) for n in content["noise"]),
        mismatch=tuple(_mismatch(m, folder) for m in content["mismatch"]),
        hot_pixels=tuple(content["hot_pixels"]),
        warnings=tuple(content["warnings"]),
    )


def _family(plain: Mapping[str, Any]) -> SavedFamily:
    fit, test, broken = plain["fit"], plain["constant"], plain["filter_break"]
    return SavedFamily(
        run=plain["run"],
        polarity=_polarity(plain["polarity"]),
        waveform=plain["waveform"],
        pulse_width_s=_number(plain["pulse_width_s"]),
        settings=plain["settings"],
        levels=tuple(_level(lv) for lv in plain["levels"]),
        by_intercept=_line(plain["by_intercept"]),
        by_half=_line(plain["by_half"]),
        fit={} if fit is None else {name: _estimate(e) for name, e in fit["numbers"].items()},
        chi2_per_dof=math.nan if fit is None else _number(fit["chi2"]) / max(int(fit["dof"]), 1),
        why_no_fit=plain["why_no_fit"],
        test=None if test is None else SavedTest(_number(test["chi2"]), int(test["dof"]), _number(test["p_value"])),
        filter_od=None if broken is None else _estimate(broken["delta_od"]),
        theta=_estimate(plain["theta"]),
        dark_lux=_estimate(plain["dark_lux"]),
        warnings=tuple(plain["warnings"]),
    )


def _level(plain: Mapping[str, Any]) -> SavedLevel:
    return SavedLevel(
        float(plain["baseline_lux"]), float(plain["nd_od"]), _estimate(plain["half"]), _estimate(plain["intercept"]),
        _maybe(plain["theta"]), _estimate(plain["dark_lux"]), _number(plain["noise_rms"]),
        _number(plain["corner_hz"]),
    )  # fmt: skip


def _line(plain: Mapping[str, Any] | None) -> SavedLine | None:
    return None if plain is None else SavedLine(_estimate(plain["theta"]), _estimate(plain["dark_lux"]))


def _noise(plain: Mapping[str, Any]) -> SavedNoise:
    return SavedNoise(
        float(plain["baseline_lux"]), float(plain["nd_od"]), plain["settings"], _estimate(plain["on"]),
        _estimate(plain["off"]), _number(plain["random_hz"]), _number(plain["noise_rms"]),
        _number(plain["corner_hz"]),
    )  # fmt: skip


def _mismatch(plain: Mapping[str, Any], folder: Path) -> SavedMismatch:
    polarity = _polarity(plain["polarity"])
    path = folder / f"pixel_thresholds_{polarity}.npz"
    theta, error = _map(path)
    return SavedMismatch(polarity, _estimate(plain["sigma"]), _number(plain["baseline_lux"]), theta, error)


def _map(path: Path) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    from zipfile import BadZipFile

    try:
        with np.load(path) as stored:
            theta, error = (np.asarray(stored[name], np.float64) for name in ("theta_ln", "error_ln"))
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as wrong:
        raise InputError(
            f"{path}: cannot be read as thresholds of single pixels ({type(wrong).__name__}: {wrong}); "
            "characterise the run again"
        ) from None
    if theta.ndim != 2 or theta.shape != error.shape:
        raise InputError(f"{path}: is no map of pixels with its errors; characterise the run again")
    return theta, error


def _polarity(text: str) -> ResponsePolarity:
    if text == "on":
        return "on"
    if text == "off":
        return "off"
    raise ValueError(f"polarity {text!r}")


def _estimate(plain: Mapping[str, Any]) -> Estimate:
    value, low, high = (_number(plain[name]) for name in ("value", "low", "high"))
    return Estimate(value, low, high, plain["unit"], plain["note"])


def _maybe(plain: Mapping[str, Any] | None) -> Estimate | None:
    return None if plain is None else _estimate(plain)


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
