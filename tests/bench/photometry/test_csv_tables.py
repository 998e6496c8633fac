"""Tables that a user wrote: what is read, and where what is wrong with them stands."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench.photometry.csv_tables import half_last_digit, parse_table, plain_number, read_curve
from bench.photometry.meter import read_readings
from protocols.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path


def test_a_curve_is_read_with_comments_and_empty_lines(tmp_path: Path) -> None:
    file = tmp_path / "curve.csv"
    file.write_bytes(b"\xef\xbb\xbf# measured\r\nwavelength_nm, power\r\n\r\n400 , 1e-3\r\n#\r\n500,2\r\n")
    wavelength_nm, power = read_curve(file, "power")
    np.testing.assert_array_equal(wavelength_nm, [400.0, 500.0])
    np.testing.assert_array_equal(power, [0.001, 2.0])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "x.csv:1:1: expected the header wavelength_nm,qe, found ''"),
        ("wavelength,qe\n400,1\n", "x.csv:1:1: expected the header wavelength_nm,qe, found 'wavelength,qe'"),
        ("# c\nqe,wavelength_nm\n400,1\n", "x.csv:2:1: expected the header"),
        ("wavelength_nm,qe,more\n400,1,1\n", "x.csv:1:1: expected the header"),
        ("wavelength_nm,qe\n", "x.csv:1:1: expected rows below the header"),
        ("wavelength_nm,qe\n400,1\n", "x.csv:2:1: expected 2 rows or more, found 1"),
        ("wavelength_nm,qe\n400,1\n500\n", "x.csv:3:1: expected 2 cells (wavelength_nm,qe), found 1"),
        ("wavelength_nm,qe\n400,0.1\n\n500, nan\n", "x.csv:4:6: qe: expected a finite number, found 'nan'"),
        ("wavelength_nm,qe\n400,0.1\n500,inf\n", "x.csv:3:5: qe: expected a finite number, found 'inf'"),
        ("wavelength_nm,qe\n400,0.1\n500,1e999\n", "x.csv:3:5: qe: expected a finite number, found '1e999'"),
        ("wavelength_nm,qe\n400,0.1\n500,-0.1\n", "x.csv:3:5: qe: expected a number from 0, found -0.1"),
        ("wavelength_nm,qe\n400,0.1\n500,60\n", "x.csv:3:5: qe: expected a number up to 1, found 60"),
        ("wavelength_nm,qe\n0,0.1\n500,0.6\n", "x.csv:2:1: wavelength_nm: expected a number above 0, found 0"),
        (
            "wavelength_nm,qe\n400,0.1\n400,0.6\n",
            "x.csv:3:1: wavelength_nm: expected wavelengths that ascend",
        ),
        ("wavelength_nm,qe\n400,0.1\n500,1_0\n", "x.csv:3:5: qe: expected a finite number"),
    ],
)
def test_mistakes_have_their_place(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "x.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=re.escape(message)):
        read_curve(file, "qe", highest=1.0)


def test_a_file_that_is_not_there_or_no_text(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_curve(tmp_path / "none.csv", "power")
    (tmp_path / "x.csv").write_bytes(b"wavelength_nm,power\n\xff\xfe\n")
    with pytest.raises(InputError, match=r"x.csv:2:1: is not UTF-8 text"):
        read_curve(tmp_path / "x.csv", "power")


@pytest.mark.parametrize(
    ("text", "half"), [("5.55", 0.005), ("5.50", 0.005), ("120", 0.5), ("1.2e3", 50.0), ("5.", 0.5), (".5E-2", 5e-4)]
)
def test_half_of_the_last_digit(text: str, half: float) -> None:
    assert half_last_digit(text) == pytest.approx(half)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_is_read_as_python_writes_it(value: float) -> None:
    assert plain_number(repr(value)) == value


@given(st.text(st.sampled_from("0123456789.,-+eE#\n\r nainflevux_\u00bd\u0663"), max_size=60))
@settings(suppress_health_check=[HealthCheck.too_slow])
def test_any_text_is_rows_of_finite_numbers_or_one_line_of_complaint(text: str) -> None:
    try:
        rows = parse_table("level,lux,filter\n" + text, "x.csv", ("level", "lux"), ("filter",))
        numbers = [row.cells[name].number() for row in rows for name in ("level", "lux")]
    except InputError as caught:
        (problem,) = caught.problems
        sound = problem.file == "x.csv" and problem.line >= 1 and problem.column >= 1 and "\n" not in str(problem)
    else:
        sound = bool(numbers) and all(math.isfinite(number) and number >= 0.0 for number in numbers)
    assert sound


def test_readings_with_and_without_filters(tmp_path: Path) -> None:
    file = tmp_path / "r.csv"
    file.write_text("level,lux\n100,4.83\n")
    (one,) = read_readings(file)
    assert (one.line, one.level, one.lux, one.half_digit_lux, one.filter_name) == (2, 100.0, 4.83, 0.005, "clear")
    file.write_text("level,lux,filter\n100,4.83,\n100,0.48, nd10\n100,4.8,clear\n")
    assert [reading.filter_name for reading in read_readings(file)] == ["clear", "nd10", "clear"]
    file.write_text("level,lux,filter\n100,4.83,\n100,-0.48,nd10\n")
    with pytest.raises(InputError, match=r"r.csv:3:5: lux: expected a number from 0, found -0.48"):
        read_readings(file)
