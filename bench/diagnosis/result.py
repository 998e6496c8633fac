"""What a diagnosis says, and how it is written as JSON (format ``evs-bench-diagnosis/1``)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sim_backend.pixel.model import PixelModel

__all__ = ["Candidate", "Error", "Misfit", "Outcome", "Remainder", "Step", "Value", "Verdict", "quality_dict"]

Verdict = Literal["explained", "unexplained", "nothing_missing", "data_not_fit_to_judge"]


@dataclass(frozen=True, slots=True)
class Error:
    """How far a model is from a run."""

    deviance_per_dof: float  #: about 1 where it is as good as the data allow
    response_rmse: float
    heldout_deviance_per_dof: float  #: on points that the fit did not see

    def to_dict(self) -> dict[str, float]:
        """Return plain numbers."""
        return {
            "deviance_per_dof": self.deviance_per_dof,
            "response_rmse": self.response_rmse,
            "heldout_deviance_per_dof": self.heldout_deviance_per_dof,
        }


@dataclass(frozen=True, slots=True)
class Value:
    """A fitted number with its 90 % interval."""

    value: float
    low: float
    high: float
    unit: str

    def to_dict(self) -> dict[str, float | str]:
        """Return plain numbers."""
        return {"value": self.value, "low": self.low, "high": self.high, "unit": self.unit}


@dataclass(frozen=True, slots=True)
class Candidate:
    """An effect that the model lacks, and what it would bring: falls of the error, deviance per degree of freedom."""

    effect: str
    screen_drop: float  #: expected, without a refit
    refit_drop: float | None  #: found; None where it was not refitted
    p_value: float  #: that the screen expects as much of the best of all candidates by chance
    tied_with: tuple[str, ...]
    smallest: float | None  #: least size that would have been found, in the unit of its first number
    heldout_drop: float | None = None  #: found on points that the fit did not see

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers."""
        return {
            "effect": self.effect,
            "screen_drop": self.screen_drop,
            "refit_drop": self.refit_drop,
            "heldout_drop": self.heldout_drop,
            "p_value": self.p_value,
            "tied_with": list(self.tied_with),
            "smallest": self.smallest,
        }


@dataclass(frozen=True, slots=True)
class Misfit:
    """A statistic of which model and measurement disagree."""

    view: str
    point: int
    baseline_lux: float
    log_contrast: float
    observed: float
    predicted: float
    z: float

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers."""
        return {
            "view": self.view,
            "point": self.point,
            "baseline_lux": self.baseline_lux,
            "log_contrast": self.log_contrast,
            "observed": self.observed,
            "predicted": self.predicted,
            "z": self.z,
        }


@dataclass(frozen=True, slots=True)
class Step:
    """The model after an effect was added, and what it still lacks."""

    number: int
    added: str | None
    effects: tuple[str, ...]
    error: Error
    parameters: dict[str, Value]
    candidates: tuple[Candidate, ...]
    worst: tuple[Misfit, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers."""
        return {
            "step": self.number,
            "added": self.added,
            "effects": list(self.effects),
            "error": self.error.to_dict(),
            "parameters": {key: value.to_dict() for key, value in self.parameters.items()},
            "candidates": [c.to_dict() for c in self.candidates],
            "worst": [m.to_dict() for m in self.worst],
        }


@dataclass(frozen=True, slots=True)
class Remainder:
    """Where something is left that no effect of the catalogue explains."""

    axis: str
    where: str
    size: float
    z: float

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers."""
        return {"axis": self.axis, "where": self.where, "size": self.size, "z": self.z}


@dataclass(frozen=True)
class Outcome:
    """What was found."""

    runs: tuple[str, ...]
    findings: tuple[str, ...]  #: why the data are not fit to be judged; empty: they are
    steps: tuple[Step, ...]
    verdict: Verdict
    missing: tuple[str, ...]
    ties: dict[str, tuple[str, ...]]
    remainder: tuple[Remainder, ...] = ()
    next_measurement: dict[str, Any] | None = None  #: empty where nothing that is known would help
    model: PixelModel | None = field(default=None, compare=False)  #: with all that was added
    shortened: str = ""  #: how much of the recordings was looked at, where it was not all
    stopped: bool = False  #: before all was tried that is known: by a person, or at the most effects that were asked
    cautions: tuple[str, ...] = ()  #: what is to be known of data that are fit to be judged
    not_asked: dict[str, str] = field(default_factory=dict)  #: effects that could not be looked for, and why

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and texts, as they stand in the JSON."""
        return {
            "format": "evs-bench-diagnosis/1",
            "runs": list(self.runs),
            "data_quality": quality_dict(self.findings, self.shortened, self.cautions),
            "noise_floor": 1.0,
            "steps": [s.to_dict() for s in self.steps],
            "verdict": self.verdict,
            "stopped": self.stopped,
            "missing": list(self.missing),
            "ties": {key: list(value) for key, value in self.ties.items()},
            "remainder": [r.to_dict() for r in self.remainder],
            "next_measurement": self.next_measurement or None,
            "no_measurement_helps": self.next_measurement == {},
            "not_asked": dict(self.not_asked),
        }


def quality_dict(findings: Sequence[str], shortened: str, cautions: Sequence[str] = ()) -> dict[str, Any]:
    """Return whether data are fit to judge, what was found, and how much was looked at where it was not all.

    Data may be fit, and something is to be known of them.
    """
    found: dict[str, Any] = {"ok": not findings, "findings": [*findings, *cautions]}
    return found | ({"looked_at": shortened} if shortened else {})
