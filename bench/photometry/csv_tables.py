"""Small tables of numbers that a user wrote as CSV, with the line and the column of whatever is wrong.

Cells are separated by commas and are not quoted; empty lines, and lines that begin with ``#``, are passed over.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from protocols.errors import InputError, Problem
from protocols.files import read_text

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator, Sequence

    import numpy.typing as npt

__all__ = ["Cell", "Row", "half_last_digit", "parse_table", "plain_number", "read_curve", "read_table"]

_FEWEST_ROWS: Final = 2  #: of a curve
_NUMBER: Final = re.compile(r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?")
_LARGEST_POWER: Final = 300  # of ten


@dataclass(frozen=True, slots=True)
class Cell:
    """What stands in one place of a table."""

    text: str
    name: str  #: of its column
    source: str
    line: int
    column: int

    def number(self, *, lowest: float = 0.0, highest: float = math.inf, over: bool = False) -> float:
        """Return it as a finite number from `lowest` to `highest`; with `over`, above `lowest`.

        Raises
        ------
        InputError
            It is none, with file, line and column.
        """
        value = plain_number(self.text)
        if value is None:
            raise self.wrong(f"expected a finite number, found {self.text!r}")
        if value < lowest or (over and value == lowest):
            raise self.wrong(f"expected a number {'above' if over else 'from'} {lowest:g}, found {self.text}")
        if value > highest:
            raise self.wrong(f"expected a number up to {highest:g}, found {self.text}")
        return value

    def wrong(self, message: str) -> InputError:
        """Return an error that says what is wrong with this cell."""
        return InputError(Problem(f"{self.name}: {message}", self.source, self.line, self.column))


@dataclass(frozen=True, slots=True)
class Row:
    """One line of a table."""

    line: int
    cells: dict[str, Cell]  #: by the name of the column


def plain_number(text: str) -> float | None:
    """Return a finite number in plain notation; None for anything else (``nan``, ``1_000``, ``0x10`` too)."""
    if not _NUMBER.fullmatch(text):
        return None
    value = float(text)
    return value if math.isfinite(value) else None


def half_last_digit(text: str) -> float:
    """Return half a unit of the last digit with which a number is written: what rounding may have taken from it.

    Examples
    --------
    >>> half_last_digit("5.55"), half_last_digit("120"), half_last_digit("1.2e3")
    (0.005, 0.5, 50.0)
    """
    mantissa, _, exponent = text.lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    power = int(exponent or 0) - decimals - 1
    return 5.0 * 10.0 ** min(max(power, -_LARGEST_POWER), _LARGEST_POWER)


def read_table(path: str | os.PathLike[str], columns: Sequence[str], optional: Sequence[str] = ()) -> list[Row]:
    """Return the rows of a file; see :func:`parse_table`."""
    return parse_table(read_text(path), str(path), columns, optional)


def parse_table(text: str, source: str, columns: Sequence[str], optional: Sequence[str] = ()) -> list[Row]:
    """Return the rows of a table, one or more.

    Parameters
    ----------
    text
        First a header that names the columns, then the rows.
    source
        Name of the file, for messages.
    columns
        Names that the header has, in this order.
    optional
        Names that may follow; without one, its cells are empty.

    Raises
    ------
    InputError
        The header is another one, there are no rows, or a row has more or fewer cells than the header.
    """
    lines = _lines(text)
    first, header = next(lines, (1, ""))
    names = [name.strip() for name in header.split(",")]
    known = [*columns, *optional]
    if names not in [known[:n] for n in range(len(columns), len(known) + 1)]:
        wanted = ",".join(columns) + "".join(f"[,{name}]" for name in optional)
        raise InputError(Problem(f"expected the header {wanted}, found {header.strip()[:80]!r}", source, first, 1))
    rows = []
    for number, line in lines:
        texts = line.split(",")
        if len(texts) != len(names):
            message = f"expected {len(names)} cells ({','.join(names)}), found {len(texts)}"
            raise InputError(Problem(message, source, number, 1))
        rows.append(Row(number, _cells(texts, names, source, number, optional)))
    if not rows:
        raise InputError(Problem("expected rows below the header, found none", source, first, 1))
    return rows


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Yield number and text of each line that says something."""
    # Not splitlines: it also splits at characters that editors do not count as the end of a line.
    for number, line in enumerate(text.replace("\r\n", "\n").split("\n"), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, line


def _cells(texts: list[str], names: list[str], source: str, line: int, optional: Sequence[str]) -> dict[str, Cell]:
    cells = {name: Cell("", name, source, line, 1) for name in optional}
    column = 1
    for name, text in zip(names, texts, strict=True):
        at = column + len(text) - len(text.lstrip())
        cells[name] = Cell(text.strip(), name, source, line, at)
        column += len(text) + 1
    return cells


def read_curve(
    path: str | os.PathLike[str], value: str, highest: float = math.inf
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Return wavelengths (nm, ascending) and values of a file with the header ``wavelength_nm,VALUE``.

    Parameters
    ----------
    path
        The file.
    value
        Name of the second column, whose numbers go from 0 to `highest`.

    Raises
    ------
    InputError
        With the place of what is wrong.
    """
    rows = read_table(path, ("wavelength_nm", value))
    wavelengths: list[float] = []
    for row in rows:
        cell = row.cells["wavelength_nm"]
        wavelength = cell.number(over=True)
        if wavelengths and wavelength <= wavelengths[-1]:
            raise cell.wrong(f"expected wavelengths that ascend, found {wavelength:g} after {wavelengths[-1]:g}")
        wavelengths.append(wavelength)
    if len(rows) < _FEWEST_ROWS:
        raise InputError(Problem(f"expected {_FEWEST_ROWS} rows or more, found 1", str(path), rows[0].line, 1))
    values = [row.cells[value].number(highest=highest) for row in rows]
    return np.array(wavelengths), np.array(values)
