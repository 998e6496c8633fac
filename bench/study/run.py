"""A whole study: its tasks, one by one or side by side, and what became of its claims."""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING

from bench.compute import Workforce
from bench.study.claims import judge
from bench.study.tasks import run_task, tasks_of
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from bench.study.claims import Finding
    from bench.study.schema import Study, Variant
    from bench.study.tasks import Outcome

__all__ = ["StudyResult", "run_study", "variants_of"]


@dataclass(frozen=True, slots=True)
class StudyResult:
    """All that came out."""

    study: Study
    quick: bool
    seed: int
    variants: tuple[Variant, ...]  #: those that were run, grids spelled out
    outcomes: Mapping[tuple[str, str], Outcome]  #: by variant and stimulus
    findings: tuple[Finding, ...]  #: one for each claim

    def of_grid(self, name: str) -> tuple[Variant, ...]:
        """Return the variants of a grid that were run."""
        own = {v.name for grid in self.study.grids if grid.name == name for v in grid.variants(quick=self.quick)}
        return tuple(v for v in self.variants if v.name in own)


def variants_of(study: Study, only: Sequence[str], *, quick: bool) -> tuple[Variant, ...]:
    """Return the variants to run, grids spelled out.

    Parameters
    ----------
    only
        Names of variants and grids; empty for all.

    Raises
    ------
    InputError
        A name is not in the study.
    """
    names = [v.name for v in study.variants] + [g.name for g in study.grids]
    for name in only:
        if name not in names:
            close = get_close_matches(name, names, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"there are {', '.join(names)}"
            raise InputError(f"the study has no variant and no grid {name!r}; {hint}")
    single = [v for v in study.variants if v.name in only or not (only or (quick and not v.in_quick))]
    grids = [v for g in study.grids if not only or g.name in only for v in g.variants(quick=quick)]
    return (*single, *grids)


def run_study(
    study: Study,
    *,
    seed: int,
    quick: bool,
    only: Sequence[str] = (),
    workforce: Workforce | None = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> StudyResult:
    """Simulate and analyse all variants, and judge the claims.

    Parameters
    ----------
    seed
        The same seed gives the same numbers, whoever computes and whatever else is run.
    quick
        Whether the effort and the grids of a quick run are meant.
    only
        Names of variants and grids to run; empty for all.
    workforce
        Who computes; default is this process.
    progress
        Called with how many tasks are done, of how many, and what the last one was.
    """
    variants = variants_of(study, only, quick=quick)
    tasks = [task for variant in variants for task in tasks_of(study, variant, seed, quick=quick)]
    outcomes: dict[tuple[str, str], Outcome] = {}
    with (workforce or Workforce()).open() as executor:
        for _, outcome in executor.map(run_task, tasks, name=lambda task: f"{task.variant}, {task.stimulus}"):
            outcomes[outcome.variant, outcome.stimulus] = outcome
            if progress is not None:
                progress(len(outcomes), len(tasks), f"{outcome.variant}, {outcome.stimulus}")
    return StudyResult(study, quick, seed, variants, outcomes, judge(study, outcomes))
