"""The catalogue for people: a table, newest first, and below it the folders that are no runs."""

from __future__ import annotations

import io
import shutil
import sys
from typing import TYPE_CHECKING, Final, Literal

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rich.table import Table

    from bench.catalogue.entry import RunEntry

__all__ = ["length_text", "runs_text", "size_text"]

#: Columns of the table, and what stands in them.
_COLUMNS: Final[dict[str, Callable[[RunEntry], str]]] = {
    "begun": lambda entry: _begun(entry),
    "run": lambda entry: entry.folder,
    "protocol": lambda entry: entry.protocol,
    "station": lambda entry: entry.station,
    "sensor": lambda entry: entry.sensor + (f" ({entry.serial})" if entry.serial else ""),
    "points": lambda entry: _points(entry),
    "state": lambda entry: entry.state,
    "quality": lambda entry: ", ".join(f"{n} {verdict}" for verdict, n in entry.verdicts.items() if n),
    "took": lambda entry: "" if entry.duration_s is None else length_text(entry.duration_s),
    "size": lambda entry: size_text(entry.bytes),
}
_RIGHT: Final = ("took", "size")
#: What a terminal that is too narrow for all goes without, the first of them first.
_DISPENSABLE: Final = ("size", "station", "took", "sensor", "protocol", "quality")
_COLOURS: Final = {
    "finished": "green",
    "aborted": "red",
    "running": "cyan",
    "paused": "yellow",
    "suspended": "yellow",
    "interrupted": "yellow",
}
_BETWEEN: Final = 3  #: characters between two columns
#: Where the table does not go to a terminal, nothing is cut.
_FILE_WIDTH: Final = 1000


def runs_text(entries: Sequence[RunEntry], width: int | None = None) -> str:
    """Return runs as a table, and a line for each folder that is none or has something wrong.

    Parameters
    ----------
    entries
        In the order in which they are shown.
    width
        Number of characters in a line; None for that of the terminal, or for all that there is elsewhere. Columns
        that find no room are left out, and names of runs never.
    """
    runs = [entry for entry in entries if entry.is_run]
    problems = [f"{entry.folder}: {entry.problem}" for entry in entries if entry.problem]
    parts = [_table_text(runs, width or _width())] if runs else []
    return "\n\n".join([*parts, *(["\n".join(problems)] if problems else [])])


def _width() -> int:
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else _FILE_WIDTH


def _table_text(runs: Sequence[RunEntry], width: int) -> str:
    from rich.console import Console

    cells = {name: [cell(entry) for entry in runs] for name, cell in _COLUMNS.items()}
    cells = _fitting({name: texts for name, texts in cells.items() if any(texts)}, width)
    # Drawn into a text of its own: what happens when a pipe is closed is the command line's to know.
    console = Console(file=io.StringIO(), force_terminal=sys.stdout.isatty(), width=_FILE_WIDTH, highlight=False)
    with console.capture() as drawn:
        console.print(_table(cells), soft_wrap=True)
    return "\n".join(line.rstrip() for line in drawn.get().rstrip("\n").split("\n"))


def _fitting(cells: dict[str, list[str]], width: int) -> dict[str, list[str]]:
    """Return the columns that fit into a line of `width` characters; what cannot be dispensed with stays."""
    left_out = [name for name in _DISPENSABLE if name in cells]
    while left_out and sum(_width_of(name, cells[name]) + _BETWEEN for name in cells) - _BETWEEN > width:
        gone = left_out.pop(0)
        cells = {name: texts for name, texts in cells.items() if name != gone}
    return cells


def _width_of(name: str, texts: Sequence[str]) -> int:
    from rich.cells import cell_len

    return max(cell_len(text) for text in (name, *texts))


def _table(cells: Mapping[str, Sequence[str]]) -> Table:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, header_style="bold")
    for name, texts in cells.items():  # with its width told, a column of a thousand cells is not measured again
        justify: Literal["left", "right"] = "right" if name in _RIGHT else "left"
        table.add_column(name, justify=justify, no_wrap=True, width=_width_of(name, texts))
    for row in zip(*cells.values(), strict=True):
        styles = (_COLOURS.get(text, "") if name == "state" else "" for name, text in zip(cells, row, strict=True))
        table.add_row(*[Text(text, style=style) for text, style in zip(row, styles, strict=True)])
    return table


def _begun(entry: RunEntry) -> str:
    created = entry.created_at
    return f"{created.astimezone():%Y-%m-%d %H:%M}" if created else ""


def _points(entry: RunEntry) -> str:
    """Return ``64``, or where something is missing ``60 of 64, 1 failed``."""
    lost = {"failed": entry.failed, "skipped": entry.skipped, "rejected": entry.rejected}
    parts = [f"{number} {what}" for what, number in lost.items() if number]
    all_done = entry.done == entry.planned and not parts
    return ", ".join([str(entry.done) if all_done else f"{entry.done} of {entry.planned}", *parts])


def length_text(seconds: float) -> str:
    """Return a length of time as people say it, in two units at most."""
    minutes = seconds / 60.0
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{minutes:.0f} min" if minutes < 90.0 else f"{int(minutes // 60)} h {int(minutes % 60):02d} min"


def size_text(size: float) -> str:
    """Return a number of bytes as people say it."""
    for unit in ("B", "kB", "MB", "GB"):
        if size < 999.5:
            return f"{size:.3g} {unit}"
        size /= 1000.0
    return f"{size:.3g} TB"
