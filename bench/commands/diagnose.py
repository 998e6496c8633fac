"""`evs-bench diagnose`: which physics a model of a run lacks."""

from __future__ import annotations

import sys
import threading
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from bench.commands.common import (
    effects_option,
    json_option,
    part_folder,
    print_json,
    results_folder,
    results_option,
    say,
)
from bench.commands.diagnosing import Teller, fit_options, model_of, open_runs, size_of
from bench.commands.evaluating import DIAGNOSIS
from bench.run.stop import StopFlag

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from bench.diagnosis.comparison import ResidualsByStep
    from bench.diagnosis.diagnosis import Diagnosis
    from bench.diagnosis.result import Outcome

__all__ = ["command"]


@click.command(name="diagnose")
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN...")
@fit_options
@click.option(
    "--max-effects", type=click.IntRange(0), default=3, show_default=True, metavar="N",
    help="Effects that are added at the most; with --interactive you say it.",
)  # fmt: skip
@click.option(
    "--minutes", type=click.FloatRange(0, min_open=True), metavar="M",
    help="End the search after so many minutes and keep what was found; without it, when all is tried.",
)  # fmt: skip
@click.option("--interactive", "by_hand", is_flag=True, help="Ask after each step which effect is to be added.")
@effects_option
@results_option
@json_option
def command(
    runs: tuple[Path, ...],
    model_file: str | None,
    seed: int,
    workers: int,
    whole: bool,
    max_effects: int,
    minutes: float | None,
    by_hand: bool,
    out: Path | None,
    as_json: bool,
) -> None:
    """Say which effects a pixel model of RUN lacks, add them, and show how the error falls.

    Several runs of one sensor are explained together. What is found is printed, and written to RUN/diagnosis: the
    accepted model, tables of residuals, figures, and a page. `evs-bench report RUN` shows it too. Ctrl-C, a polite
    kill, or --minutes ends the search and keeps what was found; a second Ctrl-C ends at once.

    Example:  evs-bench diagnose my_run --max-effects 2
    """
    from bench.diagnosis.comparison import residuals_by_step
    from bench.diagnosis.diagnosis import Diagnosis
    from bench.diagnosis.telling.by_axis import first_places
    from bench.diagnosis.telling.wording import head_line, lines_of
    from bench.diagnosis.workers import processes
    from bench.logs import LOG_FILE, log_into
    from bench.report.diagnosis import PAGE

    if by_hand:
        _for_a_search("max_effects", "minutes")
    model = model_of(model_file)
    opened = open_runs(runs)
    results = results_folder(runs[0], out)
    folder = part_folder(results, DIAGNOSIS)
    show: Callable[[str], None] = say if as_json else _print
    with log_into(results / LOG_FILE), Teller() as tell:
        with Diagnosis(
            opened, model, seed=seed, tell=tell, workforce=processes(workers), whole=whole
        ) as diagnosis:  # fmt: skip
            but = [f"fit to judge, but {caution}" for caution in diagnosis.cautions]

            def search() -> Outcome:
                return _by_hand(diagnosis, tell, show, but) if by_hand else diagnosis.run(max_effects)

            outcome, cut_short = _until_stopped(diagnosis, search, tell, minutes)
            outcome = _reasons_alone(outcome) if outcome.findings else outcome
            residuals = residuals_by_step(diagnosis.problem, diagnosis.fits) if outcome.steps else {}
        tell("drawing the figures")
        _save(outcome, residuals, folder)
    if as_json:
        print_json(outcome.to_dict())
    elif not by_hand or cut_short:
        show(head_line(outcome.runs, *size_of(opened), outcome.findings))
        for line in (*but, *lines_of(outcome, first_places(residuals))):
            show(line)
    what = "the reasons are" if outcome.findings else "model, tables and figures are"
    where = f"{what} in {folder}; open {folder / PAGE} in a browser"
    if cut_short:
        raise KeyboardInterrupt(f"stopped; {where}")
    say(where)


def _for_a_search(*names: str) -> None:
    """Refuse options that say when a search ends: by hand a person says it."""
    context = click.get_current_context()
    for name in names:
        if context.get_parameter_source(name) is not ParameterSource.DEFAULT:
            option = name.replace("_", "-")
            raise click.UsageError(f"--{option} says nothing with --interactive; expected one of the two")


def _until_stopped(
    diagnosis: Diagnosis, search: Callable[[], Outcome], tell: Teller, minutes: float | None
) -> tuple[Outcome, bool]:
    """Return what a search found, or had found when it was ended; and whether a person or a kill ended it."""
    stop = StopFlag()
    try:
        with stop.listening(), stop.idle(), _time_limit(stop, minutes):
            return search(), False
    except KeyboardInterrupt:
        if not diagnosis.begun:
            raise KeyboardInterrupt(f"{stop.reason}, before the model was fitted" if stop.reason else "") from None
    tell(f"{stop.reason or 'stopping'}, with what was found so far (Ctrl-C: at once)")
    return diagnosis.outcome(measure_next=False), not stop.reason


@contextmanager
def _time_limit(stop: StopFlag, minutes: float | None) -> Iterator[None]:
    """Stop after so many minutes."""
    if minutes is None:
        yield
        return
    timer = threading.Timer(60 * minutes, stop.at_once, [f"stopped after {minutes:g} min"])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _print(line: str) -> None:
    click.echo(line)


def _save(outcome: Outcome, residuals: ResidualsByStep, folder: Path) -> None:
    """Write all files of a diagnosis."""
    from bench.diagnosis.telling.saving import save_outcome
    from bench.report.diagnosis import write_diagnosis

    folder.mkdir(exist_ok=True)
    save_outcome(outcome, folder, residuals)
    write_diagnosis(folder)


def _reasons_alone(outcome: Outcome) -> Outcome:
    """Return why the data are not fit to be judged, without what a person looked at all the same."""
    from bench.diagnosis.result import Outcome

    return Outcome(
        runs=outcome.runs, findings=outcome.findings, steps=(), verdict=outcome.verdict, missing=(), ties={},
        shortened=outcome.shortened, stopped=outcome.stopped, cautions=outcome.cautions,
    )  # fmt: skip


def _by_hand(diagnosis: Diagnosis, tell: Teller, show: Callable[[str], None], but: Sequence[str]) -> Outcome:
    """Let a person pick the effects; `but` is what is to be known before."""
    from bench.diagnosis.comparison import residuals_by_step
    from bench.diagnosis.telling.interactive import watch
    from bench.diagnosis.telling.wording import shortened_lines

    def residuals() -> ResidualsByStep:
        return residuals_by_step(diagnosis.problem, diagnosis.fits)

    def ask(question: str) -> str | None:
        tell.rest()
        click.echo(question, nl=False, err=True)
        return sys.stdin.readline() or None

    def show_at_rest(line: str) -> None:
        tell.rest()
        show(line)

    for line in (*but, *shortened_lines(diagnosis.shortened)):
        show_at_rest(line)
    return watch(diagnosis, ask, show_at_rest, residuals)
