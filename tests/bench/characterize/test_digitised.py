"""Curves that were measured elsewhere."""

from __future__ import annotations

import contextlib
import math
import tempfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtr

from bench.characterize.characterize import characterize_curves
from bench.characterize.digitised import digitised_families, read_points
from bench.characterize.readings import Uncertainties
from bench.characterize.weber import contrast_needed
from protocols.errors import InputError

HEADER = "log_contrast,probability,baseline_lux,probability_sd"


def family(theta: float, dark: float, levels: tuple[float, ...], width: float = 0.03) -> str:
    """Return curves of a Gaussian of the signal: its 50 % point is the threshold at every level."""
    lines = [HEADER]
    for lux in levels:
        middle = contrast_needed(theta, lux, dark, "on")
        for k in range(-6, 7):
            contrast = middle * (1.0 + 0.05 * k)
            signal = math.log((lux * math.exp(contrast) + dark) / (lux + dark))
            lines.append(f"{contrast:.6f},{ndtr((signal - theta) / width):.6f},{lux},0.01")
    return "\n".join(lines)


def test_a_family_gives_back_what_it_was_made_from(tmp_path: Path) -> None:
    path = tmp_path / "family.csv"
    path.write_text(family(0.35, 0.14626, (0.076, 0.152, 0.304, 3.0, 300.0)))
    found = characterize_curves("family", digitised_families(read_points(path)), Uncertainties())
    (one,) = found.families
    assert one.by_half is not None
    # The curve is bent a little in log contrast where the light is dim: 1 %.
    assert one.by_half.theta.value == pytest.approx(0.35, rel=0.01)
    assert one.by_half.dark_lux.value == pytest.approx(0.14626, rel=0.03)
    assert found.dark is not None
    assert found.dark.current_fa is None
    assert one.fit is None
    assert one.why_no_fit == "curves without pixels"


def test_the_error_of_a_reading_is_that_of_the_points(tmp_path: Path) -> None:
    path = tmp_path / "family.csv"
    widths = []
    for sd in ("0.01", "0.04"):
        path.write_text(family(0.35, 0.14626, (0.076, 300.0)).replace(",0.01", f",{sd}"))
        (one,) = digitised_families(read_points(path))
        widths.append(one.curves[0].half.high - one.curves[0].half.low)
    assert 2.5 < widths[1] / widths[0] < 6.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ":1"),
        ("log_contrast,probability\n0.1,0.2", "lacks baseline_lux"),
        (HEADER + ",colour\n", "has colour"),
        (HEADER + "\n0.1,0.2,1", "as many cells as the header has"),
        (HEADER + "\n0.1,1.2,1,0.01", "probability is '1.2'; expected a number from 0 to 1"),
        (HEADER + "\n0.1,nan,1,0.01", "probability is 'nan'"),
        (HEADER + "\n0.1,0.2,0,0.01", "baseline_lux is '0'"),
        ("log_contrast,probability,baseline_lux\n0.1,0.2,1", "--probability-sd"),
        ("polarity," + HEADER + "\nup,0.1,0.2,1,0.01", "polarity is 'up'; expected on or off"),
        (HEADER + "\n", "no points"),
    ],
)
def test_bad_input_is_named_with_its_line(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "curves.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=r"curves\.csv") as caught:
        read_points(path)
    assert message in str(caught.value)


@given(st.text(max_size=200))
def test_no_text_does_anything_but_points_or_one_clear_error(text: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "curves.csv"
        path.write_text(HEADER + "\n" + text, encoding="utf-8")
        with contextlib.suppress(InputError):
            assert read_points(path)


def test_a_flat_curve_has_no_reading(tmp_path: Path) -> None:
    path = tmp_path / "flat.csv"
    path.write_text(HEADER + "".join(f"\n{0.1 * k},0.5,{lux},0.01" for lux in (1, 10) for k in range(8)))
    found = characterize_curves("flat", digitised_families(read_points(path)), Uncertainties())
    assert found.dark is None
    assert math.isnan(found.families[0].theta.value)
