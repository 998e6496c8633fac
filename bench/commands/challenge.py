"""`evs-bench challenge`: a simulated station of which nobody is told what it is, and the truth in the end."""

from __future__ import annotations

import secrets
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from bench.commands.common import SEED, json_option, print_json, print_table, say

if TYPE_CHECKING:
    from bench.challenge.score import Named, Score, Scored
    from bench.challenge.truth import Truth

__all__ = ["command"]

_MOST_EFFECTS = 3
_SEEDS = 2**32


@click.group(name="challenge")
def command() -> None:
    """Diagnose a simulated station of which nobody is told what it is, and see how close you came."""


@command.command()
@click.option("--seed", type=SEED, help="The same seed, the same station; default is one that nobody knows.")
@click.option("--level", type=click.Choice(["easy", "medium", "hard"]), default="medium", show_default=True,
              help="One large effect; one or two; one to three of any size.")  # fmt: skip
@click.option("--effects-count", type=click.IntRange(0, _MOST_EFFECTS),
              help="How many effects there are; default is drawn.")  # fmt: skip
@click.option("--may-be-nothing", is_flag=True,
              help="Sometimes the sensor lacks nothing: no effect at all, at any level.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), help="Folder to make; default is the name of the station.")
@json_option
def new(
    seed: int | None,
    level: Literal["easy", "medium", "hard"],
    effects_count: int | None,
    may_be_nothing: bool,
    out: Path | None,
    as_json: bool,
) -> None:
    """Make a blind station: a base pixel, and one or more effects of random kind and size.

    Its file names the instruments and the calibration. What the pixel is stands in a sealed file beside it, and a run
    on the station keeps nothing of it but its name.
    """
    from bench.challenge.folder import STATION_FILE, make_challenge

    if may_be_nothing and effects_count is not None:
        raise click.UsageError("--may-be-nothing says nothing beside --effects-count; expected one of the two")
    chosen = secrets.randbelow(_SEEDS) if seed is None else seed
    folder = make_challenge(chosen, level, effects_count, out, may_be_nothing=may_be_nothing)
    station = folder / STATION_FILE
    if as_json:
        print_json({"format": "evs-bench-challenge/1", "folder": str(folder), "station": str(station)})
    else:
        click.echo(str(folder))
    say(f"measure it with: evs-bench run challenge --station {station}")
    say(f"in the end: evs-bench challenge reveal {folder}")


@command.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--diagnosis", type=click.Path(path_type=Path),
              help="What `evs-bench diagnose --json` printed, to be held against the truth.")  # fmt: skip
@click.option("--run", "runs", type=click.Path(path_type=Path), multiple=True,
              help="A run that was diagnosed, once for each; needed where a protocol set biases.")  # fmt: skip
@json_option
def reveal(folder: Path, diagnosis: Path | None, runs: tuple[Path, ...], as_json: bool) -> None:
    """Show what the blind station in FOLDER is, and what a diagnosis of it is worth."""
    from bench.challenge.folder import read_truth
    from bench.challenge.score import read_diagnosis, require_diagnosis_of, score
    from bench.challenge.truth import biases_of
    from bench.store import Run

    truth = read_truth(folder)
    taken = [Run.open(run) for run in runs]
    settings = biases_of(taken, truth.station)
    scored = None
    if diagnosis is not None:
        told = read_diagnosis(diagnosis)
        if taken:
            require_diagnosis_of(taken, told, diagnosis)
        scored = score(truth, told, settings)
    if as_json:
        found = None if scored is None else scored.to_dict()
        head = {"format": "evs-bench-challenge-reveal/1", "station": truth.station}
        print_json({**head, "truth": truth.to_dict(settings), "score": found})
    elif scored is None:
        _print_effects(truth)
        print_table(("number", "truth", "unit"), [(n.key, f"{n.value:.4g}", n.unit) for n in truth.numbers(settings)])
    else:
        _print_effects(truth)
        _print_score(scored)
    if not runs and not as_json:
        if scored is not None:
            say("that the diagnosis is of this station is not seen from it; name its runs in order with --run")
        say("thresholds, corner and dead time are those at the factory biases; "
            "where a protocol set others, name its run with --run")  # fmt: skip


def _print_effects(truth: Truth) -> None:
    effects = ", ".join(truth.effects) or "none, the base pixel alone"
    click.echo(f"station {truth.station}, effects: {effects}\n")


def _print_score(scored: Score) -> None:
    header = ("number", "truth", "diagnosis (90 % interval)", "unit", "truth is")
    print_table(header, [_row(n) for n in scored.numbers])
    click.echo("")
    for named in scored.named:
        tied = f" (or {', '.join(named.tied_with)})" if named.tied_with else ""
        click.echo(f"{named.effect}{tied}: {_judged(named)}")
    for effect in scored.missed:
        click.echo(f"{effect}: missed")
    click.echo(f"verdict: {scored.verdict}")


def _judged(named: Named) -> str:
    if named.truth is None:
        return "named wrongly"
    return "right" if named.truth == named.effect else f"right, it is {named.truth}"


def _row(n: Scored) -> tuple[str, str, str, str, str]:
    if not n.told:
        return (n.key, f"{n.truth:.4g}", "not told", n.unit, "")
    told = f"{n.value:.4g} ({_end(n.low)} to {_end(n.high)})"
    return (n.key, f"{n.truth:.4g}", told, n.unit, "inside" if n.inside else "outside")


def _end(value: float | None) -> str:
    return "open" if value is None else f"{value:.4g}"
