"""What `compare` and `diagnose` share: the runs, where the results go, and telling what is being done."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import click

from bench.commands.common import SEED, say

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path
    from types import TracebackType

    from bench.models.pixel_files import PixelModel
    from bench.store import Run

__all__ = ["Teller", "fit_options", "model_of", "open_runs", "size_of"]

_model_option = click.option(
    "--model", "model_file", metavar="FILE", help="A pixel model to start from; default is the base pixel alone."
)
_seed_option = click.option(
    "--seed", type=SEED, default=1, show_default=True, help="Of the simulations; the same seed, the same result."
)
_workers_option = click.option(
    "--workers", type=click.IntRange(1), default=2, show_default=True, metavar="N", help="Processes that simulate."
)


_whole_option = click.option(
    "--whole", is_flag=True,
    help="Look at all of long recordings and large windows, however long it takes; default: as much as says enough.",
)  # fmt: skip


def _load_views(ctx: click.Context, _param: click.Parameter, files: tuple[str, ...]) -> None:
    if files and not ctx.resilient_parsing:
        from bench.diagnosis.views.registry import load_view_files

        load_view_files(files)


_views_option = click.option(
    "--views", multiple=True, metavar="FILE", expose_value=False, callback=_load_views,
    help="A Python file with a view of your own; it is run. Can be given several times.",
)  # fmt: skip


def fit_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command `--model`, `--seed`, `--workers`, `--whole` and `--views`."""
    return _model_option(_seed_option(_workers_option(_whole_option(_views_option(command)))))


def model_of(file: str | None) -> PixelModel | None:
    """Return the model in a file; None where none is named."""
    from bench.models.pixel_files import read_model_file

    return None if file is None else read_model_file(file)


def open_runs(folders: Sequence[Path]) -> tuple[Run, ...]:
    """Open runs without their damaged points, which are told."""
    from bench.store import Run

    found = tuple(Run.open(folder).without_damaged() for folder in folders)
    for run in found:
        for line in run.damaged:
            say(f"left out: {line}")
    return found


def size_of(runs: Sequence[Run]) -> tuple[int, int]:
    """Return the number of points of all runs, and of pixels in the largest window."""
    pixels = [point.roi.pixels for run in runs for point in run.points()]
    return len(pixels), max(pixels, default=0)


class Teller:
    """Tells the operator what is being done: a line that changes on a terminal, lines elsewhere; all on stderr."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._task: Any = None

    def __enter__(self) -> Teller:
        if sys.stderr is not None and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

            columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
            self._bar = Progress(*columns, console=Console(file=sys.stderr), transient=True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.rest()

    def __call__(self, text: str) -> None:
        """Tell what is being done now."""
        if self._bar is None:
            say(text)
            return
        if self._task is None:
            self._task = self._bar.add_task(text, total=None)
            self._bar.start()
        self._bar.update(self._task, description=text)

    def rest(self) -> None:
        """Leave the terminal alone until there is something to tell again."""
        if self._task is not None:
            self._bar.stop()
            self._bar.remove_task(self._task)
            self._task = None
