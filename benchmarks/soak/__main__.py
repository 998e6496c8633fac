"""Print how a run holds out kills and a night: ``python -m benchmarks.soak [--kills 200] [--hours 12]``."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.soak.kills import kill_and_resume
from benchmarks.soak.night import KINDS, spend_a_night

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.soak.kills import Kills
    from benchmarks.soak.night import Night


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _kills_text(found: Kills) -> list[str]:
    lines = [f"{found.kills} kills in {found.runs} runs, each followed by a resume"]
    lines += [f"  {place:<34}{number:>5}" for place, number in sorted(found.places.items())]
    return [*lines, *_problems_text(found.problems)]


def _night_text(night: Night) -> list[str]:
    memory = ", ".join(f"{hour:.3g} h {mib:.0f} MiB" for hour, mib in sorted(night.memory_mib.items()))
    return [
        f"a night of {night.hours:.1f} h of bench time, in {night.real_s / 60.0:.1f} min",
        f"  {sum(night.faults.values())} faults of {len(night.faults)} kinds (of {len(KINDS)})",
        f"  {night.points} points: {night.done} done, {night.skipped} skipped; "
        f"{night.failures} attempts failed, {night.taken_again} were judged bad",
        f"  resident memory: {memory}",
        *_problems_text(night.problems),
    ]


def _problems_text(problems: Sequence[str]) -> list[str]:
    return [f"  PROBLEM {text}" for text in problems] or ["  nothing is wrong"]


def main(arguments: Sequence[str]) -> int:
    """Run what is asked for; return 1 if something is wrong."""
    parser = argparse.ArgumentParser(prog="benchmarks.soak", description=__doc__)
    parser.add_argument("--kills", type=int, default=200, help="kills; 0 for none")
    parser.add_argument("--hours", type=float, default=12.0, help="length of the night, h of bench time; 0 for none")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="where the runs are left; a temporary folder if not given")
    asked = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as temporary:
        folder = asked.folder or Path(temporary)
        problems: list[str] = []
        if asked.kills:
            found = kill_and_resume(folder / "kills", asked.kills, asked.seed, _tell)
            print("\n".join(_kills_text(found)), flush=True)
            problems += found.problems
        if asked.hours:
            night = spend_a_night(folder / "night", asked.hours, asked.seed, _tell)
            print("\n".join(_night_text(night)), flush=True)
            problems += night.problems
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
