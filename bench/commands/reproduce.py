"""`evs-bench reproduce`: a published study once more, on simulated pixels, beside what was claimed."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bench.commands.common import SEED, json_option, print_json, print_table, say
from bench.commands.running import workforce_of, workforce_options

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.study.run import StudyResult

__all__ = ["command"]

_LEAST_BETWEEN_LINES_S = 10.0


@click.command(name="reproduce")
@click.argument("study")
@click.option("--quick", is_flag=True, help="Fewer pixels, pulses and places of grids: it takes minutes.")
@click.option("--only", multiple=True, metavar="VARIANT", help="Run this variant or grid only; may be repeated.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for the report, made if it is not there; default is STUDY-quick or STUDY-full.",
)
@click.option("--seed", type=SEED, default=1, show_default=True, help="Another seed, other events.")
@workforce_options
@json_option
def command(
    study: str,
    quick: bool,
    only: tuple[str, ...],
    out: Path | None,
    seed: int,
    workers: int,
    cluster: str | None,
    as_json: bool,
) -> int:
    """Run the simulations of a published STUDY and hold them against what it says.

    STUDY is the name of one that is shipped ("paper"), or a study file. The report says of each claim what came out,
    in ln units unless it says otherwise, with its 90 % interval, and why where it does not agree. A claim that does
    not hold is a finding, not a failure: the exit code is 0.

    Example: evs-bench reproduce paper --quick --workers 2
    """
    from bench.study.loading import load_study
    from bench.study.report import write_study_report
    from bench.study.run import run_study, variants_of

    loaded = load_study(study)
    folder = out or Path(f"{Path(study).stem}-{'quick' if quick else 'full'}")
    variants_of(loaded, only, quick=quick)
    folder.mkdir(parents=True, exist_ok=True)  # that it cannot be written is said before, not after the work
    workforce = workforce_of(workers, cluster)
    result = run_study(loaded, seed=seed, quick=quick, only=only, workforce=workforce, progress=_told_now_and_then())
    say("drawing the report")
    page = write_study_report(result, folder)
    if as_json:
        print_json(_as_json(result, page))
    else:
        _print(result, page)
    return 0


def _told_now_and_then() -> Callable[[int, int, str], None]:
    """Return a function that says how far it is, every ten seconds and at the end."""
    last = time.monotonic()

    def tell(done: int, total: int, what: str) -> None:
        nonlocal last
        now = time.monotonic()
        if done == total or now - last >= _LEAST_BETWEEN_LINES_S:
            last = now
            say(f"{done} of {total} simulations done; last: {what}")

    return tell


def _print(result: StudyResult, page: Path) -> None:
    from bench.study.report import expectation_text, number_text, verdict_counts

    judged = [f for f in result.findings if f.verdict != "not run"]
    if judged:
        rows = [(f.claim.name, expectation_text(f), number_text(f.measured), f.verdict) for f in judged]
        print_table(("claim", "expected", "came out (90 % interval)", "verdict"), rows)
        click.echo("")
    for finding in judged:
        if finding.verdict == "does not agree":
            click.echo(f"{finding.claim.name}: {finding.claim.says}. It does not: {finding.claim.otherwise}.")
    counts = verdict_counts(result.findings)
    click.echo(", ".join(f"{number} {verdict}" for verdict, number in counts.items() if number))
    click.echo(f"report: {page.resolve()}")


def _as_json(result: StudyResult, page: Path) -> dict[str, object]:
    claims = [
        {
            "claim": f.claim.name,
            "says": f.claim.says,
            "source": f.claim.source,
            "quantity": f.claim.quantity,
            "unit": f.claim.unit,
            "least": f.claim.limits[0],
            "most": f.claim.limits[1],
            "measured": f.measured.value,
            "low": f.measured.low,
            "high": f.measured.high,
            "verdict": f.verdict,
        }
        for f in result.findings
    ]
    return {"format": "evs-bench-reproduce/1", "quick": result.quick, "report": str(page), "claims": claims}
