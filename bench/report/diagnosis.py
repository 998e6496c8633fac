"""The diagnosis in a report: what was missing, the fall of the error, the residuals, the ranking, the numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from bench.diagnosis.telling.reading import BINS_FILE, JSON_FILE, read_bins, read_outcome
from bench.diagnosis.telling.wording import (
    apart_line,
    blind,
    fall_text,
    not_asked_lines,
    p_text,
    remainder_text,
    shortened_parts,
    significant,
    smallest,
    verdict_line,
)
from bench.report import captions
from bench.report.figures import error_fall, ranking
from bench.report.residual_pictures import fitted_cell, fitted_name, residual_pictures
from bench.report.results_table import Cell, Table
from bench.report.showing import FIGURES, Picture, show
from bench.report.wording import MISSING, capital
from bench.store.durable import write_whole
from bench.store.layout import PART_SUFFIX

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from bench.diagnosis.result import Candidate, Outcome
    from bench.diagnosis.telling.by_axis import Bin
    from bench.report.showing import Shown

__all__ = ["PAGE", "DiagnosisSection", "diagnosis_pictures", "diagnosis_section", "write_diagnosis"]

PAGE: Final = "diagnosis.html"


@dataclass(frozen=True, slots=True)
class DiagnosisSection:
    """What a page says of a diagnosis."""

    runs: tuple[str, ...]
    verdict: str
    notes: tuple[str, ...]  #: what part was looked at, what is left over, what to measure next
    steps: Table
    parameters: Table
    candidates: Table | None  #: of the last step: what is not significant
    smallest: Table | None  #: what would have been seen, where nothing is missing
    figures: tuple[Shown, ...]


def diagnosis_section(folder: Path, figures: Path) -> DiagnosisSection | None:
    """Return the section about the diagnosis in `folder`, or None where there is none.

    Parameters
    ----------
    folder
        Where `evs-bench diagnose` wrote its results.
    figures
        Where the figures are written; their names begin with ``diagnosis_``.

    Raises
    ------
    InputError
        The files cannot be read as a diagnosis.
    """
    if not (folder / JSON_FILE).exists():
        return None
    outcome, bins = read_outcome(folder / JSON_FILE), read_bins(folder / BINS_FILE)
    return _section(outcome, show(diagnosis_pictures(outcome, bins), figures))


def write_diagnosis(folder: Path) -> Path:
    """Write the page of the diagnosis in `folder`, and its figures, and return the path of the page.

    Raises
    ------
    InputError
        There is no diagnosis, or it cannot be read.
    """
    from bench.report.template import template
    from protocols.errors import InputError

    section = diagnosis_section(folder, folder / FIGURES)
    if section is None:
        raise InputError(f"{folder}: has no {JSON_FILE}; expected what 'evs-bench diagnose' writes")
    page = folder / PAGE
    write_whole(page, template(PAGE).render(diagnosis=section), PART_SUFFIX)
    return page


def diagnosis_pictures(outcome: Outcome, bins: Mapping[int, Sequence[Bin]]) -> Iterator[Picture]:
    """Yield the figures of a diagnosis that make sense, most important first."""
    labels = {s.number: "start" if s.added is None else f"+ {s.added.replace('_', ' ')}" for s in outcome.steps}
    known = {number: mine for number, mine in sorted(bins.items()) if number in labels}
    fall = error_fall.prepare(outcome)
    if fall is not None:
        yield Picture(
            "diagnosis_error", "The fall of the error", captions.error_fall(fall), lambda: error_fall.draw(fall)
        )
    yield from residual_pictures("diagnosis", known, labels)
    ranks = ranking.prepare(outcome)
    if ranks is not None:
        yield Picture(
            "diagnosis_ranking", "Candidates at each step", captions.ranking(ranks), lambda: ranking.draw(ranks)
        )


def _section(outcome: Outcome, figures: tuple[Shown, ...]) -> DiagnosisSection:
    apart = apart_line(outcome)
    notes = [f"{capital(part)}." for part in shortened_parts(outcome.shortened)]
    notes += [f"Left over: {remainder_text(r)}." for r in outcome.remainder]
    notes += [f"{capital(apart)}."] if apart is not None else []
    unseen = blind(outcome) if outcome.verdict == "nothing_missing" else []
    notes += [f"Not to be seen in these data at any size: {', '.join(_words(unseen))}."] if unseen else []
    notes += [f"{capital(line)}." for line in not_asked_lines(outcome)]
    return DiagnosisSection(
        runs=outcome.runs,
        verdict=capital(verdict_line(outcome).removeprefix("verdict: ")),
        notes=tuple(notes),
        steps=_steps(outcome),
        parameters=_parameters(outcome),
        candidates=_candidates(outcome.steps[-1].candidates) if outcome.steps else None,
        smallest=_smallest(outcome),
        figures=figures,
    )


def _steps(outcome: Outcome) -> Table:
    heads = (
        ("step", ""), ("model", ""), ("error", "deviance per dof"), ("on unseen points", "deviance per dof"),
        ("response", "rms"),
    )  # fmt: skip
    rows = []
    for step in outcome.steps:
        what = ", ".join(_words(step.effects)) if step.added is None else f"+ {_word(step.added)}"
        error = step.error
        cells = (significant(error.deviance_per_dof), significant(error.heldout_deviance_per_dof))
        rows.append(tuple(Cell(t) for t in (f"{step.number}", what, *cells, f"{error.response_rmse:.3f}")))
    return Table(heads, tuple(rows), 2)


def _parameters(outcome: Outcome) -> Table:
    """Return the fitted numbers: a row for each, a column for each step."""
    keys = list(dict.fromkeys(k for s in outcome.steps for k in s.parameters))
    heads = (("number", ""), *((f"step {s.number}", "" if s.added is None else f"+ {_word(s.added)}")
                               for s in outcome.steps))  # fmt: skip
    rows = tuple((fitted_name(key), *(fitted_cell(s.parameters.get(key)) for s in outcome.steps)) for key in keys)
    return Table(heads, rows, 1)


def _candidates(candidates: Sequence[Candidate]) -> Table | None:
    shown = [c for c in candidates if c.screen_drop > 0.0 or c.refit_drop is not None]
    if not shown:
        return None
    heads = (
        ("candidate", ""), ("expected fall", "of the error"), ("after a refit", "of the error"),
        ("on unseen points", "of the error"), ("p", ""),
    )  # fmt: skip
    rows = [
        (
            Cell(_word(c.effect)),
            Cell(fall_text(c.screen_drop)),
            Cell(MISSING if c.refit_drop is None else fall_text(c.refit_drop)),
            Cell(MISSING if c.heldout_drop is None else fall_text(c.heldout_drop)),
            Cell(p_text(c.p_value)),
        )
        for c in shown
    ]
    return Table(heads, tuple(rows), 1)


def _smallest(outcome: Outcome) -> Table | None:
    if outcome.verdict != "nothing_missing":
        return None
    rows = tuple((Cell(_word(effect)), Cell(size)) for effect, size in smallest(outcome))
    return Table((("effect", ""), ("would have been seen from", "")), rows, 1) if rows else None


def _word(name: str) -> str:
    return name.replace("_", " ")


def _words(names: Sequence[str]) -> list[str]:
    return [_word(n) for n in names if n != "alignment"]
