"""Looking a protocol over before anything is switched on: what cannot be taken, what will mislead, time and size."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Any, Literal

from bench.run.findings import NEEDED, observe_curve, observe_point, observe_settings
from bench.run.plan import plan, ranges_text
from bench.run.progress import duration_text
from protocols.errors import InputError
from protocols.points import ResetTestTiming

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable, Sequence

    from bench.run.findings import Observation
    from bench.station import Station
    from protocols.estimation import Estimate
    from protocols.expected import Expected
    from protocols.points import Point
    from protocols.schema import Protocol

__all__ = ["CheckReport", "Finding", "check"]


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

    @property
    def refused(self) -> bool:
        """Whether a point cannot be taken."""
        return any(f.severity == "error" for f in self.findings)

    def lines(self) -> list[str]:
        """Return the report for people, a line for each thing."""
        e = self.estimate
        steps = f", {_count(e.operator_steps, 'operator step')}" if e.operator_steps else ""
        points, changes = _count(e.points, "point"), _count(e.nd_changes, "change")
        return [
            f"{self.title}: {points} on station {self.station}, {changes} of the filter{steps}",
            f"time: {duration_text(e.duration_s)} ({duration_text(e.settling_s)} of it to settle), "
            f"until {self.end:%Y-%m-%d %H:%M}; size: at most about {_size_text(e.bytes)}",
            *(str(f) for f in self.findings),
            *(f"not checked: {line}" for line in self.not_checked),
            _verdict(self.findings),
        ]

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
        }


def check(protocol: Protocol, station: Station) -> CheckReport:
    """Return what `station`, which is not connected to, and the expected pixel have to say about `protocol`."""
    points = protocol.expand()
    estimate = protocol.estimate()
    _, refusals = plan(points, station)
    errors = [Finding("error", "cannot_be_taken", r.measurement, r.points, r.message) for r in refusals]
    expected = {p.index: _expected(protocol, p, station) for p in points}
    return CheckReport(
        title=protocol.title,
        station=station.name,
        findings=(*errors, *_warnings(points, expected, station)),
        estimate=estimate,
        not_checked=_not_checked(points, expected),
        end=datetime.now().astimezone() + timedelta(seconds=estimate.duration_s),
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


def _warnings(points: Sequence[Point], expected: dict[int, Expected], station: Station) -> list[Finding]:
    seen: list[Observation] = []
    uncalibrated = station.calibration.uncalibrated
    for point in points:
        seen += observe_point(point, expected[point.index], station.light)
        seen += observe_settings(point, uncalibrated)
    for curve in _curves(points):
        seen += observe_curve(curve, expected[curve[0].index])
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


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _verdict(findings: Sequence[Finding]) -> str:
    errors = sum(f.severity == "error" for f in findings)
    warnings = len(findings) - errors
    if errors:
        return f"this cannot be taken: {errors} error{'s' * (errors > 1)}"
    return f"this can be taken, with {warnings} warning{'s' * (warnings > 1)}" if warnings else "this can be taken"


def _size_text(size: float) -> str:
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000.0:
            return f"{size:.3g} {unit}"
        size /= 1000.0
    return f"{size:.3g} TB"
