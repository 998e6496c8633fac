"""From the entries of a queue to its runs, one by one: repetitions, and references between them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from bench.queueing.schema import OnFailure, QueueEntry, QueueFile, ReferenceSection, WarmUpSection
    from protocols import LoadedProtocol

__all__ = ["MOST_RUNS", "QueuedRun", "plan_runs"]

#: In one queue, references included.
MOST_RUNS: Final = 2000


@dataclass(frozen=True, slots=True)
class QueuedRun:
    """One run of a queue."""

    number: int  #: from 1, in the order in which they are taken
    name: str
    protocol: str  #: as it is written in the queue file
    station: str  #: as it is written, or the queue's own
    seed: int | None  #: None for those of the protocol
    on_failure: OnFailure
    duration_s: float  #: measuring and settling, s; a warm-up is not in it
    warm_up: WarmUpSection | None = None
    is_reference: bool = False

    @property
    def folder(self) -> str:
        """Name of its run folder, below that of the queue."""
        return f"{self.number:03d}-{self.name}"

    @property
    def longest_s(self) -> float:
        """The longest that it is planned to take, its warm-up included, s."""
        return self.duration_s + (self.warm_up.longest_s if self.warm_up else 0.0)


def plan_runs(file: QueueFile, protocols: Mapping[str, LoadedProtocol], station: str) -> tuple[QueuedRun, ...]:
    """Return the runs of a queue in their order.

    Parameters
    ----------
    file
        The queue.
    protocols
        The protocols that it names, by that name.
    station
        Station of the runs whose entry names none.

    Notes
    -----
    The first repetition of an entry has the seed that is asked for, or those of the protocol; each one after it has
    the next number, so that repetitions of a simulated run are not copies. A reference comes first and last, and
    between as often as is asked for; of a warm-up before the run that follows it, it gets the benefit.
    """
    planner = _Planner(file, protocols, station)
    runs = [run for entry in file.entries for run in planner.runs_of(entry)]
    if file.reference is not None:
        runs = planner.with_references(runs, file.reference)
    return tuple(replace(run, number=number) for number, run in enumerate(runs, start=1))


class _Planner:
    """Makes runs of entries."""

    def __init__(self, file: QueueFile, protocols: Mapping[str, LoadedProtocol], station: str) -> None:
        self._file = file
        self._protocols = protocols
        self._station = station
        self._durations_s = {name: p.protocol.estimate().duration_s for name, p in protocols.items()}

    def runs_of(self, entry: QueueEntry) -> list[QueuedRun]:
        """Return the repetitions of one entry; the first of them is warmed up for."""
        return [
            QueuedRun(
                number=0,
                name=entry.name or PurePath(entry.protocol).stem,
                protocol=entry.protocol,
                station=entry.station or self._station,
                seed=self._seed(entry, repetition),
                on_failure=entry.on_failure or self._file.on_failure,
                duration_s=self._durations_s[entry.protocol],
                warm_up=entry.warm_up if repetition == 0 else None,
            )
            for repetition in range(entry.repeat)
        ]

    def with_references(self, runs: Sequence[QueuedRun], reference: ReferenceSection) -> list[QueuedRun]:
        """Return `runs` with references before, between and after them."""
        planned: list[QueuedRun] = []
        taken, since, since_s = 0, 0, 0.0
        for run in runs:
            due = not planned or self._is_due(reference, since, since_s + run.longest_s)
            if due:
                planned.append(replace(self._reference(reference, taken), warm_up=run.warm_up))
                taken, since, since_s = taken + 1, 0, 0.0
            planned.append(replace(run, warm_up=None) if due else run)
            since, since_s = since + 1, since_s + run.longest_s
        return [*planned, self._reference(reference, taken)]

    @staticmethod
    def _is_due(reference: ReferenceSection, since: int, until_s: float) -> bool:
        """Return whether a reference comes before the next run, at whose end `until_s` will have passed."""
        if reference.every is not None:
            return since >= reference.every
        return since > 0 and until_s > 60.0 * (reference.every_minutes or 0.0)

    def _reference(self, reference: ReferenceSection, repetition: int) -> QueuedRun:
        return QueuedRun(
            number=0,
            name=reference.name,
            protocol=reference.protocol,
            station=reference.station or self._station,
            seed=self._seed(reference, repetition),
            on_failure=self._file.on_failure,
            duration_s=self._durations_s[reference.protocol],
            is_reference=True,
        )

    def _seed(self, part: QueueEntry | ReferenceSection, repetition: int) -> int | None:
        if repetition == 0:
            return part.seed
        first = self._protocols[part.protocol].protocol.seed if part.seed is None else part.seed
        return (first + repetition) % 2**63
