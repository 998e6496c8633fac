"""From a run to what the biases do: tables with intervals, and the pair of thresholds that is quiet enough."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Final

from bench.analysis.whole import analyze
from bench.bias_calibration.conditions import BIASES, swept_curves, swept_points
from bench.bias_calibration.dead_time import dead_time_table
from bench.bias_calibration.fits import Curves, corner_table, threshold_table
from bench.bias_calibration.quiet import noise_rates, tune
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from bench.analysis.results import Analysis, ResponsePolarity, ResponseRow
    from bench.analysis.whole import RunLike
    from bench.bias_calibration.quiet import NoiseRate, Tuning
    from bench.bias_calibration.table import BiasTable
    from bench.store.data import PointData

__all__ = ["BiasCalibration", "calibrate_biases"]

FORMAT: Final = "evs-bench-bias-calibration/1"


@dataclass(frozen=True, slots=True)
class BiasCalibration:
    """What the biases of a sensor do, as one run shows it."""

    run_id: str
    created: str  #: when the run was taken, ISO 8601; empty if it does not say
    tables: tuple[BiasTable, ...]
    rates: tuple[NoiseRate, ...]  #: background, by pair of threshold offsets
    rate_biases: tuple[str, str]  #: those of the ON and of the OFF threshold
    tuning: Tuning | None  #: None where no rate was asked for, or none can be had
    remarks: tuple[str, ...]

    @property
    def usable(self) -> tuple[BiasTable, ...]:
        """Tables that make a curve."""
        return tuple(table for table in self.tables if table.usable)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data, for programs."""
        return {
            "format": FORMAT,
            "run": self.run_id,
            "created": self.created,
            "tables": {table.quantity: _table_dict(table) for table in self.tables},
            "background": [asdict(rate) for rate in self.rates],
            "tuning": None if self.tuning is None else asdict(self.tuning),
            "remarks": list(self.remarks),
        }


def _table_dict(table: BiasTable) -> dict[str, Any]:
    def rows(which: Sequence[Any]) -> list[dict[str, Any]]:
        return [{**asdict(row), **_interval(row.estimate(table.quantity))} for row in which]

    return {
        "bias": table.bias,
        "usable": table.usable,
        "rows": rows(table.rows),
        "dropped": rows(table.dropped),
        "broken": rows(table.broken),
    }


def _interval(estimate: Any) -> dict[str, Any]:
    return {"low": estimate.low, "high": estimate.high, "unit": estimate.unit}


def calibrate_biases(
    run: RunLike,
    *,
    biases: Mapping[str, str] | None = None,
    light_edge_s: float | None = None,
    target_hz: float | None = None,
    tell: Callable[[str], None] | None = None,
) -> BiasCalibration:
    """Find what the biases do from a run of the protocol ``bias_calibration``, or one like it.

    Points are sorted by the biases that were read back, not by the names of the measurements: a quantity is read off
    the largest group of points that differ in its bias alone.

    Parameters
    ----------
    run
        An opened run.
    biases
        Which bias sets which quantity, where that differs from :data:`~bench.bias_calibration.conditions.BIASES`.
    light_edge_s
        10 % to 90 % of an edge of the light, s; None where it is not known.
    target_hz
        Background events per pixel and second, ON and OFF together, that are allowed.
    tell
        Called with what is being done.

    Raises
    ------
    InputError
        No bias was swept.
    bench.store.errors.RunError
        A file of the run is damaged.
    """
    say = tell or _silent
    names = {**BIASES, **(biases or {})}
    points = {p.index: p for p in run.points()}
    say("events are counted")
    analysis = analyze(run, pixel_maps=False, theta_fit=_no_fit)
    tables = _tables(analysis, points, names, light_edge_s, run.header.everything.get("station") or {}, say)
    if not any(table.rows for table in tables):
        raise InputError(
            f"{run.header.id}: no bias was swept; take a run of the protocol bias_calibration",
            *[remark for table in tables for remark in table.remarks],
        )
    pair = names["theta_on"], names["theta_off"]
    constant = swept_points((p for p in points.values() if p.waveform == "constant"), pair)
    rates = noise_rates(analysis.background, constant, *pair)
    tuning = None if target_hz is None else _tuned(target_hz, rates, tables)
    remarks = [remark for table in tables for remark in table.remarks]
    if isinstance(tuning, str):
        remarks.append(f"background: {tuning}")
    return BiasCalibration(
        run_id=run.header.id,
        created=run.header.created,
        tables=tables,
        rates=rates,
        rate_biases=pair,
        tuning=None if isinstance(tuning, str) else tuning,
        remarks=tuple(remarks),
    )


def _silent(text: str) -> None:
    del text


def _no_fit(rows: Sequence[ResponseRow]) -> None:
    del rows  # curves are fitted afterwards, each with the threshold of the other polarity at hand


def _tables(
    analysis: Analysis,
    points: Mapping[int, PointData],
    names: Mapping[str, str],
    light_edge_s: float | None,
    station: Mapping[str, Any],
    tell: Callable[[str], None],
) -> tuple[BiasTable, ...]:
    responses = analysis.responses
    own: dict[ResponsePolarity, str] = {"on": names["theta_on"], "off": names["theta_off"]}
    thresholds = {polarity: swept_curves(responses, points, polarity, bias) for polarity, bias in own.items()}
    curves = Curves(thresholds, own, points)
    corner_bias, dead_bias = names["bandwidth_hz"], names["refractory_s"]
    corners = max((swept_curves(responses, points, polarity, corner_bias) for polarity in own), key=len)
    dead = swept_points(points.values(), (dead_bias,))
    return (
        threshold_table("theta_on", own["on"], thresholds["on"], curves, tell),
        threshold_table("theta_off", own["off"], thresholds["off"], curves, tell),
        dead_time_table(dead_bias, dead, station),
        corner_table("bandwidth_hz", corner_bias, corners, curves, light_edge_s, tell),
    )


def _tuned(target_hz: float, rates: Sequence[NoiseRate], tables: Sequence[BiasTable]) -> Tuning | str:
    on, off = tables[0], tables[1]
    if not (on.usable and off.usable):
        return "without both thresholds there is no pair to choose"
    return tune(target_hz, rates, on.curve(), off.curve())
