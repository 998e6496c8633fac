"""The whole self test of a station, and its report."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final

from bench.selftest import camera, light
from bench.selftest.steps import Step, carry_out

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from bench.station import Station

__all__ = ["SelfTest", "run_selftest"]

_TESTS: Final[tuple[tuple[str, str, Callable[[Station], Iterator[Step]]], ...]] = (
    ("light", "levels", light.levels),
    ("wheel", "filters", light.filters),
    ("camera", "health", camera.health),
    ("camera", "biases", camera.biases),
    ("camera", "dead time", camera.dead_time),
    ("light", "edges", light.edges),
    ("camera", "window", camera.window),
)


@dataclass(frozen=True, slots=True)
class SelfTest:
    """What was found."""

    station: str
    identities: Mapping[str, Mapping[str, str]]
    steps: tuple[Step, ...]

    @property
    def bad(self) -> int:
        """Number of steps that failed."""
        return sum(step.outcome == "bad" for step in self.steps)

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, for programs."""
        return {
            "format": "evs-bench-selftest/1",
            "station": self.station,
            "devices": {role: dict(identity) for role, identity in self.identities.items()},
            "steps": [asdict(step) for step in self.steps],
        }

    def markdown(self) -> str:
        """Return it as a page for the lab's folder."""
        lines = [
            f"# Self test of station {self.station}",
            "",
            "| role | maker | model | serial | firmware |",
            "|---|---|---|---|---|",
        ]
        lines += [
            f"| {role} | {' | '.join(identity.get(key, '') for key in ('maker', 'model', 'serial', 'firmware'))} |"
            for role, identity in self.identities.items()
        ]
        lines += ["", "| | device | what | found | expected |", "|---|---|---|---|---|"]
        lines += [f"| {s.outcome} | {s.role} | {s.what} | {s.found} | {s.expected} |" for s in self.steps]
        return "\n".join(lines) + "\n"


def run_selftest(station: Station, tell: Callable[[str], None] = lambda _: None) -> SelfTest:
    """Connect to a station, look at all of its instruments, and leave it dark.

    Raises
    ------
    DevicesFailed
        An instrument does not answer at all.
    """
    with station:
        station.connect()
        steps: list[Step] = []
        for role, what, test in _TESTS:
            tell(f"{role}: {what}")
            steps += carry_out(role, what, lambda test=test: test(station))  # type: ignore[misc]
        return SelfTest(station.name, station.identities(), tuple(steps))
