"""The characterization in the report: its numbers, its figures, and the page."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bench.characterize.characterize import characterize_curves
from bench.characterize.digitised import DigitisedPoint, digitised_families
from bench.characterize.readings import Uncertainties
from bench.characterize.saving import save
from bench.report import write_report
from bench.report.characterization import characterization_section, draw_characterization
from bench.report.characterized import read_characterization
from bench.report.figures import bandwidth, level_thresholds, mismatch, noise_light, weber
from bench.report.figures.style import house_style
from bench.report.saving import lay_out
from protocols.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from bench.analysis.results import Analysis
    from bench.report.characterized import SavedCharacterization

Maker = Callable[..., Any]
NAMES = ("weber", "thresholds", "bandwidth", "noise", "mismatch")
LEVELS = ((0.076, 3.0), (0.152, 3.0), (0.304, 3.0), (0.304, 0.0), (3.0, 0.0), (100.0, 0.0))
DARK_LUX = 0.2
THETA = {"on": math.log(1.4), "off": math.log(1.25)}  # W = 0.4 and 0.2 far above the dark light
TAU_S = 1e-3
SLOW_S_LUX = 3e-3


def estimate(value: float | None, reach: float = 0.0, unit: str = "ln", note: str = "") -> dict[str, Any]:
    if value is None:
        return {"value": None, "low": None, "high": None, "unit": unit, "note": "flat"}
    return {"value": value, "low": value - reach, "high": value + reach, "unit": unit, "note": note}


def needed(polarity: str, lux: float) -> float:
    """Return the log contrast that changes the signal by the threshold."""
    if polarity == "on":
        return math.log1p(0.4 * (1.0 + DARK_LUX / lux))
    return -math.log1p(-0.2 * (1.0 + DARK_LUX / lux))


def level(polarity: str, lux: float, nd_od: float, *, fit: bool, slow: bool) -> dict[str, Any]:
    contrast = needed(polarity, lux)
    return {
        "baseline_lux": lux, "nd_od": nd_od, "half": estimate(0.9 * contrast, 0.01),
        "intercept": estimate(contrast, 0.03), "theta": estimate(THETA[polarity], 0.002) if fit else None,
        "dark_lux": estimate(DARK_LUX, 0.01, "lux"), "parts": {"curve": 0.005}, "noise_rms": 0.04 if fit else None,
        "corner_hz": (lux + DARK_LUX) / (2.0 * math.pi * SLOW_S_LUX) if fit and slow else None,
    }  # fmt: skip


def family(polarity: str = "on", *, fit: bool = True, slow: bool = False, **changed: Any) -> dict[str, Any]:
    """Return a family whose intercepts lie on the line exactly."""
    line = {
        "theta": estimate(THETA[polarity], 0.01), "dark_lux": estimate(DARK_LUX, 0.02, "lux"), "chi2": 3.2, "dof": 4,
        "levels": [0.0] * len(LEVELS),
    }  # fmt: skip
    numbers = {
        "theta": estimate(THETA[polarity], 0.005), "noise_rms": estimate(0.04, 0.001),
        "mismatch2": estimate(1e-4, 1e-5, "ln2"), "ln_tau": estimate(math.log(TAU_S), 0.1, "ln(s)"),
        "dark_lux": estimate(DARK_LUX, 0.01, "lux"), "slow_s_lux": estimate(SLOW_S_LUX, 3e-4, "s lux"),
    }  # fmt: skip
    plain = {
        "run": "by-hand", "polarity": polarity, "waveform": "reset_test", "pulse_width_s": 0.02, "settings": "",
        "levels": [level(polarity, lux, od, fit=fit, slow=slow) for lux, od in LEVELS], "by_intercept": line,
        "by_half": line, "fit": {"numbers": numbers, "chi2": 50.0, "dof": 54} if fit else None,
        "why_no_fit": "" if fit else "too few contrasts", "constant": {"chi2": 3.2, "dof": 4, "p_value": 0.52,
        "largest": 0.001}, "filter_break": {"delta_od": estimate(0.003, 0.004, "OD")} if fit else None,
        "theta": estimate(THETA[polarity], 0.005), "dark_lux": estimate(DARK_LUX, 0.01, "lux"), "biased": 0.01,
        "warnings": [],
    }  # fmt: skip
    return {**plain, **changed}


def noise(lux: float, on_hz: float, off_hz: float, rms: float | None = 0.05) -> dict[str, Any]:
    return {
        "baseline_lux": lux, "nd_od": 0.0, "settings": "", "on": estimate(on_hz, 0.4 * on_hz or 0.001, "Hz"),
        "off": estimate(off_hz, 0.4 * off_hz or 0.001, "Hz"), "random_hz": on_hz + off_hz - max(on_hz - off_hz, 0.0),
        "leak_per_s": None, "noise_rms": rms, "corner_hz": None if rms is None else 160.0,
    }  # fmt: skip


def characterization(**changed: Any) -> dict[str, Any]:
    plain: dict[str, Any] = {
        "format": "evs-bench-characterization/1", "runs": ["by-hand"], "interval": 0.9,
        "families": [family("off", slow=True), family("on", slow=True)],
        "dark_light": {
            "lux": estimate(DARK_LUX, 0.01, "lux"), "parts": {"chance": 0.006, "illuminance": 0.0},
            "current_fa": estimate(5.1, 0.3, "fA"), "current_parts": {"illuminance": 0.15, "eta": 0.1},
            "photodiode": {"eta": {"value": 0.6, "sd": 0.02}, "pitch_m": {"value": 4.86e-6, "sd": 0.0},
                           "photons_per_lux": {"value": 1.12e16, "sd": 0.0}}, "scatter": None,
        },
        "cutoffs": [{"polarity": "on", "log_contrast": math.log(2.0), "measured_lux": estimate(0.14, 0.01, "lux"),
                     "predicted_lux": estimate(0.133, 0.01, "lux"), "sigma": 0.8}],
        "noise": [noise(0.0, 0.3, 0.05), noise(0.1, 0.09, 0.03), noise(1.0, 0.01, 0.004), noise(100.0, 0.002, 0.0)],
        "mismatch": [{"polarity": p, "sigma": estimate(0.02, 0.003), "spread_of_map_ln": 0.02, "baseline_lux": 100.0}
                     for p in ("on", "off")],
        "hot_pixels": [{"x": 5, "y": 7, "rate_hz": 12.0, "usual_hz": 0.1}],
        "uncertainties": {"light": 0.0, "contrast": 0.0, "nd_od": None, "eta": 0.02},
        "warnings": ["the fit is poor"],
    }  # fmt: skip
    return {**plain, **changed}


def write(folder: Path, **changed: Any) -> Path:
    """Write a characterization with its maps into `folder`, and return the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    plain = characterization(**changed)
    (folder / "characterization.json").write_text(json.dumps(plain), encoding="utf-8")
    rng = np.random.default_rng(4)
    for one in plain["mismatch"]:
        theta = rng.normal(THETA.get(one["polarity"], 0.3), 0.025, (12, 16))
        theta[2, 3] = np.nan
        path = folder / f"pixel_thresholds_{one['polarity']}.npz"
        np.savez_compressed(path, theta_ln=theta, error_ln=np.full_like(theta, 0.015))
    return folder


@pytest.fixture(name="found")
def all_there_is(tmp_path: Path) -> SavedCharacterization:
    return read_characterization(write(tmp_path / "c"))


def test_readings_lie_on_a_line_that_meets_zero_at_the_dark_light(found: SavedCharacterization) -> None:
    numbers = weber.prepare(found.families)
    assert numbers is not None
    assert [p.polarity for p in numbers.panels] == ["off", "on"]
    on = numbers.panels[1]
    assert [line.name for line in on.lines] == ["fit", "intercept", "half"]
    best, points = on.lines[0], on.points[1]
    assert best.w == pytest.approx(0.4)
    assert best.crossing == pytest.approx(-1.0 / DARK_LUX)
    assert points.weber == pytest.approx(best.at(points.inverse_lux))
    assert points.weber[0] == pytest.approx(0.4 * (1.0 + DARK_LUX / 0.076))
    assert points.filtered.tolist() == [True, True, True, False, False, False]
    off = numbers.panels[0]
    assert off.lines[0].w == pytest.approx(0.2)
    assert off.points[1].weber == pytest.approx(off.lines[0].at(off.points[1].inverse_lux))
    assert numbers.x_ends[0] < -1.0 / 0.19 < 1.0 / 0.076 < numbers.x_ends[1]


def test_a_far_zero_does_not_squeeze_the_points(tmp_path: Path) -> None:
    dim = family(dark_lux=estimate(0.001, 0.002, "lux"))
    numbers = weber.prepare(read_characterization(write(tmp_path, families=[dim])).families)
    assert numbers is not None
    assert -1.3 / 0.076 < numbers.x_ends[0] < 0.0


def test_thresholds_of_levels_are_those_of_the_fit(found: SavedCharacterization) -> None:
    numbers = level_thresholds.prepare(found.families)
    assert numbers is not None
    on = numbers.panels[1]
    assert on.true is not None
    assert on.apparent is not None
    assert on.true.value == pytest.approx([THETA["on"]] * len(LEVELS))
    assert on.apparent.value[0] == pytest.approx(math.log1p(0.4 * (1.0 + DARK_LUX / 0.076)))
    assert on.verdict == "one threshold holds, p = 0.52"


def test_without_a_fit_readings_are_corrected_by_the_line(tmp_path: Path) -> None:
    families = [family("on", fit=False), family("off", fit=False)]
    numbers = level_thresholds.prepare(read_characterization(write(tmp_path, families=families)).families)
    assert numbers is not None
    for panel in numbers.panels:
        assert not panel.fitted
        assert panel.true is not None
        # The dark light of the family is that of its readings, which lie on the line.
        assert panel.true.value == pytest.approx([THETA[panel.polarity]] * len(LEVELS))


def test_corners_follow_the_light(found: SavedCharacterization) -> None:
    numbers = bandwidth.prepare(found.families)
    assert numbers is not None
    one = numbers.corners[0]
    assert one.lux.tolist() == [0.076, 0.152, 0.304, 3.0, 100.0]
    assert one.at(one.lux) == pytest.approx(one.corner_hz)
    assert one.hz_per_lux[0] == pytest.approx(1.0 / (2.0 * math.pi * SLOW_S_LUX))
    assert one.low_pass_hz[0] == pytest.approx(1.0 / (2.0 * math.pi * TAU_S))
    assert one.hz_per_lux[1] < one.hz_per_lux[0] < one.hz_per_lux[2]


def test_a_photoreceptor_that_is_not_seen_has_no_figure(tmp_path: Path) -> None:
    assert bandwidth.prepare(read_characterization(write(tmp_path, families=[family()])).families) is None


def test_dark_has_a_place_of_its_own_and_noise_is_beside_that_of_the_fits(found: SavedCharacterization) -> None:
    numbers = noise_light.prepare(found.noise, found.families)
    assert numbers is not None
    assert numbers.rates.dark_at is not None
    assert numbers.random_lux.tolist() == pytest.approx([numbers.rates.dark_at, 0.1, 1.0])
    assert numbers.random_hz == pytest.approx([0.1, 0.06, 0.008])
    assert [s.source for s in numbers.noise] == ["background", "on", "off"]
    assert numbers.noise[0].lux[0] == numbers.rates.dark_at
    assert numbers.corner_hz == 160.0
    assert noise_light.prepare((), found.families) is None


def test_the_histogram_is_wider_than_the_mismatch(found: SavedCharacterization) -> None:
    numbers = mismatch.prepare(found.mismatch)
    assert numbers is not None
    one = numbers.maps[0]
    assert one.counting == pytest.approx(0.015)
    assert one.total == pytest.approx(0.025, rel=0.2)
    assert mismatch.sigma_text(one.sigma) == "0.0200 (0.0170 to 0.0230)"
    assert mismatch.prepare(()) is None


def figures_of(found: SavedCharacterization) -> list[Figure]:
    drawn = [weber.prepare(found.families), level_thresholds.prepare(found.families)]
    return [
        *(m.draw(n) for m, n in zip((weber, level_thresholds), drawn, strict=True) if n is not None),
        *(bandwidth.draw(b) for b in [bandwidth.prepare(found.families)] if b is not None),
        *(noise_light.draw(n) for n in [noise_light.prepare(found.noise, found.families)] if n is not None),
        *(mismatch.draw(m) for m in [mismatch.prepare(found.mismatch)] if m is not None),
    ]


FULL: dict[str, Any] = {}
BARE: dict[str, Any] = {
    "families": [family("on", fit=False), family("off", fit=False, by_intercept=None, by_half=None, constant=None,
                 theta=estimate(None), dark_lux=estimate(None), pulse_width_s=0.02)],
    "dark_light": None, "noise": [noise(1.0, 0.1, 0.05, None)],
    "mismatch": [{"polarity": "on", "sigma": {**estimate(0.0, 0.002), "note": "none seen"},
                  "spread_of_map_ln": 0.0, "baseline_lux": 100.0}],
}  # fmt: skip


@pytest.mark.parametrize(("changed", "many"), [(FULL, 5), (BARE, 4)])
def test_text_in_figures_does_not_overlap_and_axes_are_labelled(
    changed: dict[str, Any], many: int, tmp_path: Path
) -> None:
    with house_style():
        figures = figures_of(read_characterization(write(tmp_path, **changed)))
        assert len(figures) == many
        for figure in figures:
            lay_out(figure)
            for ax in figure.axes:
                texts = [t for t in (*ax.texts, ax.title, *ax.get_xticklabels()) if t.get_text() and t.get_visible()]
                boxes = [t.get_window_extent() for t in texts]
                clashes = [
                    (texts[i].get_text(), texts[j].get_text())
                    for i in range(len(boxes))
                    for j in range(i)
                    if boxes[i].shrunk(0.98, 0.98).overlaps(boxes[j])
                ]
                assert clashes == []
            lowest = [ax for ax in figure.axes if (at := ax.get_subplotspec()) is not None and at.is_last_row()]
            assert all(ax.get_xlabel() for ax in lowest)
            assert re.search(r"ln|Hz|W =", " ".join(ax.get_ylabel() + ax.get_xlabel() for ax in figure.axes))


def test_figures_lie_beside_the_numbers_as_png_and_pdf(tmp_path: Path) -> None:
    files = draw_characterization(write(tmp_path, noise=[], mismatch=[]))
    assert [f.name for f in files] == [f"characterization_{n}.{k}" for n in NAMES[:3] for k in ("png", "pdf")]
    assert all(f.stat().st_size > 8_000 for f in files)
    assert files[0].parent == tmp_path / "figures"


def test_families_of_two_widths_have_figures_of_their_own(tmp_path: Path) -> None:
    families = [family("on"), family("on", pulse_width_s=0.1)]
    section = characterization_section(write(tmp_path, families=families, noise=[], mismatch=[]), tmp_path / "f")
    assert section is not None
    assert [f.name.removeprefix("characterization_") for f in section.figures] == [
        "weber_1", "thresholds_1", "weber_2", "thresholds_2",
    ]  # fmt: skip
    assert "reset and test pulses of 100 ms" in section.figures[2].title


def test_the_report_of_a_run_has_the_section_if_there_is_a_characterization(
    constant: Analysis, constant_run_of: Maker, tmp_path: Path
) -> None:
    run = constant_run_of("dark")
    page = write_report(run, constant, tmp_path / "with", characterization=write(tmp_path / "c"))
    text = page.read_text(encoding="utf-8")
    assert text.index('<section id="characterization">') < text.index("<h2>Tables</h2>")
    for expected in (
        "200 mlux (190 to 210)", "5.10 fA (4.80 to 5.40)", "0.6 ± 0.02", "pitch 4.86 µm", "1.12·10¹⁶",
        "the fit is poor", "5, 7", "140 mlux (130 to 150)", "159", "0.52",
    ):  # fmt: skip
        assert expected in text, expected
    assert re.findall(r'id="characterization_(\w+)"', text) == list(NAMES)
    assert (tmp_path / "with/figures/characterization_weber.pdf").exists()
    assert "nan" not in re.sub(r"data:image[^\"]*|[a-z]*nan[a-z]+|[a-z]+nan[a-z]*", "", text.lower())
    bare = write_report(run, constant, tmp_path / "without", characterization=tmp_path / "nowhere")
    assert "Characterization" not in bare.read_text(encoding="utf-8")


def test_text_of_files_is_escaped(constant: Analysis, constant_run_of: Maker, tmp_path: Path) -> None:
    evil = "<script>alert('x')</script>"
    families = [family("on", fit=False, settings=evil, why_no_fit=evil), family("on", run=evil, warnings=[evil])]
    folder = write(tmp_path / "c", runs=["a", evil], families=families, warnings=[evil], noise=[], mismatch=[])
    page = write_report(constant_run_of("dark"), constant, tmp_path / "r", characterization=folder)
    assert "<script" not in page.read_text(encoding="utf-8")


def test_curves_of_a_file_are_read_as_they_are_saved(tmp_path: Path) -> None:
    # Families without a fit and without a pulse width, from the real files.
    points = [
        DigitisedPoint(c, 1.0 / (1.0 + math.exp(-(c - 0.3 * (1.0 + 0.3 / lux)) / 0.02)), lux, "on", 0.0, 0.01)
        for lux in (0.3, 1.0, 10.0)
        for c in np.linspace(0.1, 0.9, 41).tolist()
    ]
    save(characterize_curves("paper.csv", digitised_families(points), Uncertainties()), tmp_path)
    section = characterization_section(tmp_path, tmp_path / "f")
    assert section is not None
    assert [f.name for f in section.figures] == ["characterization_weber", "characterization_thresholds"]
    assert section.notes
    assert section.families is not None
    assert "nan" not in str(section.families).lower()


@pytest.mark.parametrize(
    "damage", ["no json", "{}", json.dumps({"format": "other/1"}), json.dumps(characterization(families=[{}])), "[]"]
)
def test_a_damaged_file_is_one_clear_error(damage: str, tmp_path: Path) -> None:
    folder = write(tmp_path)
    (folder / "characterization.json").write_text(damage, encoding="utf-8")
    with pytest.raises(InputError, match=r"characterization\.json") as caught:
        characterization_section(folder, tmp_path / "f")
    assert "\n" not in str(caught.value)


def test_a_damaged_map_is_one_clear_error(tmp_path: Path) -> None:
    folder = write(tmp_path)
    (folder / "pixel_thresholds_on.npz").write_bytes(b"PK damaged")
    with pytest.raises(InputError, match=r"pixel_thresholds_on\.npz"):
        draw_characterization(folder)
