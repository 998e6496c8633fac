"""Looking a protocol over before anything is switched on: what cannot be taken, what will mislead, time and size."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Any, Final, Literal

from bench.run.findings import NEEDED, observe_contrast, observe_curve, observe_point, observe_settings
from bench.run.foresight import foresee
from bench.run.foretelling import count_text, foresight_lines, points_text, time_lines
from bench.run.plan import plan, ranges_text
from bench.run.suspenders import problems_with
from protocols.errors import InputError
from protocols.points import ResetTestTiming

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable, Sequence
    from pathlib import Path

    from bench.run.findings import Observation
    from bench.run.foresight import Foresight
    from bench.run.plan import PlannedPoint
    from bench.station import Station
    from protocols.estimation import Estimate
    from protocols.expected import Expected
    from protocols.points import Point
    from protocols.schema import Protocol

__all__ = ["CheckReport", "Finding", "check"]

#: So many reasons why points cannot be taken are told to people, and so many warnings; programs get all.
_MOST_LINES: Final = 10


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing to know before a run: an error (points that cannot be taken) or a warning."""

    severity: Literal["error", "warning"]
    kind: str  #: which rule found it, for programs
    measurement: str
    points: tuple[int, ...]
    message: str

    def __str__(self) -> str:
        """Return the finding as one line."""
        return f"{self.severity}: {self.measurement}, {ranges_text(self.points)}: {self.message}"


@dataclass(frozen=True, slots=True)
class CheckReport:
    """What a look at a protocol found."""

    title: str
    station: str
    findings: tuple[Finding, ...]
    estimate: Estimate
    not_checked: tuple[str, ...]  #: rules that need something that is not known: which, what, and where
    end: datetime  #: when a run that starts now would be over, local time, on a bench whose time is real
    foresight: Foresight
    unreachable: tuple[int, ...] = ()  #: points that cannot be taken

    @property
    def refused(self) -> bool:
        """Whether a point cannot be taken."""
        return any(f.severity == "error" for f in self.findings)

    def lines(self) -> list[str]:
        """Return the report for people, a line for each thing."""
        e = self.estimate
        steps = f", {count_text(e.operator_steps, 'operator step')}" if e.operator_steps else ""
        points, changes = points_text(e), count_text(e.nd_changes, "change")
        return [
            f"{self.title}: {points} on station {self.station}, {changes} of the filter{steps}",
            *time_lines(e, self.foresight, self.end),
            *foresight_lines(e, self.foresight),
            *self._reach_lines(),
            *_shortened([str(f) for f in self.findings if f.severity == "error"], "reason"),
            *_shortened([str(f) for f in self.findings if f.severity == "warning"], "warning"),
            *(f"not checked: {line}" for line in self.not_checked),
            _verdict(self.findings),
        ]

    def _reach_lines(self) -> list[str]:
        if not self.unreachable:
            return []
        reasons = sum(f.severity == "error" for f in self.findings)
        of = f"{len(self.unreachable)} of {count_text(self.estimate.points - self.estimate.added, 'point')}"
        return [f"out of reach: {of}, for {count_text(reasons, 'reason')}"]

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain data, for programs."""
        return {
            "format": "evs-bench-check/1",
            "title": self.title,
            "station": self.station,
            "refused": self.refused,
            "findings": [asdict(f) for f in self.findings],
            "not_checked": list(self.not_checked),
            "estimate": asdict(self.estimate),
            "end": self.end.isoformat(timespec="seconds"),
            "foresight": _plain(self.foresight),
            "unreachable": list(self.unreachable),
        }


def _plain(foresight: Foresight) -> dict[str, Any]:
    end = foresight.real_end
    return {**asdict(foresight), "real_end": None if end is None else end.isoformat(timespec="seconds")}


def _shortened(lines: list[str], what: str) -> list[str]:
    """Return the first of `lines`, and how many more there are."""
    rest = len(lines) - _MOST_LINES
    return lines if rest <= 1 else [*lines[:_MOST_LINES], f"... and {count_text(rest, f'more {what}')}: see --json"]


def check(protocol: Protocol, station: Station, runs: Path | None = None) -> CheckReport:
    """Return what `station`, which is not connected to, and the expected pixel have to say about `protocol`.

    Parameters
    ----------
    protocol
        What is to be taken.
    station
        On what.
    runs
        The folder in which the run would lie beside earlier ones, from which its time is learned; None to look at
        neither.
    """
    points = protocol.expand()
    planned, refusals = plan(points, station)
    foresight = foresee(protocol.worst_case(), planned, station, runs)
    errors = [Finding("error", "cannot_be_taken", r.measurement, r.points, r.message) for r in refusals]
    errors += [Finding("error", "cannot_wait", "", (), text) for text in problems_with(protocol.suspend, station)]
    expected = {p.index: _expected(protocol, p, station) for p in points}
    return CheckReport(
        title=protocol.title,
        station=station.name,
        findings=(*errors, *_warnings(points, planned, expected, station)),
        estimate=protocol.estimate(),
        not_checked=_not_checked(points, expected),
        end=datetime.now().astimezone() + timedelta(seconds=foresight.duration_s),
        foresight=foresight,
        unreachable=tuple(sorted({point for r in refusals for point in r.points})),
    )


def _expected(protocol: Protocol, point: Point, station: Station) -> Expected:
    """Return what the pixel is expected to be at `point`: by its settings, else `expect`, else the bias map."""
    known = protocol.expected_at(point)
    try:
        mapped = station.calibration.settings_at(station.calibration.biases_for(point.settings))
    except InputError:
        return known  # the settings cannot be had: that is an error of its own
    missing = {name: v for name, v in mapped.items() if getattr(known, name) is None and not math.isnan(v)}
    return replace(known, **missing)


def _warnings(
    points: Sequence[Point], planned: Sequence[PlannedPoint], expected: dict[int, Expected], station: Station
) -> list[Finding]:
    seen: list[Observation] = []
    uncalibrated = station.calibration.uncalibrated
    for point in points:
        seen += observe_point(point, expected[point.index], station.light)
        seen += observe_settings(point, uncalibrated)
    for curve in _curves(points):
        seen += observe_curve(curve, expected[curve[0].index])
    for one in planned:
        seen += observe_contrast(one)
    return _gathered(seen, {p.index: p.measurement for p in points})


def _not_checked(points: Sequence[Point], expected: dict[int, Expected]) -> tuple[str, ...]:
    """Return one line for each quantity that rules need and that is not known: the rules and the measurements."""
    lines = []
    for name, (rules, applies) in NEEDED.items():
        without = [p for p in points if applies(p) and getattr(expected[p.index], name) is None]
        if without:
            measurements = ", ".join(dict.fromkeys(p.measurement for p in without))
            lines.append(f"{rules} ({measurements}): expect.{name} is not given")
    return tuple(lines)


def _curves(points: Iterable[Point]) -> list[list[Point]]:
    """Return the points by curve: what shares everything but the contrast."""
    curves: dict[Hashable, list[Point]] = {}
    for p in points:
        key = (p.measurement, p.polarity, p.baseline_lux, p.nd_od, _width_s(p), p.settings, p.roi)
        curves.setdefault(key, []).append(p)
    return list(curves.values())


def _width_s(point: Point) -> float:
    return point.timing.test_s if isinstance(point.timing, ResetTestTiming) else 0.0


def _gathered(seen: Sequence[Observation], measurement: dict[int, str]) -> list[Finding]:
    """Return one finding for each rule and measurement, with the message of its worst point."""
    groups: dict[tuple[str, str], list[Observation]] = {}
    for one in seen:
        groups.setdefault((measurement[one.point], one.kind), []).append(one)
    return [
        Finding(
            "warning",
            kind,
            name,
            tuple(sorted({o.point for o in group})),
            max(group, key=lambda o: o.badness).message,
        )
        for (name, kind), group in groups.items()
    ]


def _verdict(findings: Sequence[Finding]) -> str:
    errors = sum(f.severity == "error" for f in findings)
    warnings = len(findings) - errors
    if errors:
        return f"this cannot be taken: {errors} error{'s' * (errors > 1)}"
    return f"this can be taken, with {warnings} warning{'s' * (warnings > 1)}" if warnings else "this can be taken"
