"""A dask cluster on this machine, and diagnoses made by hand, for all tests that need one."""

from __future__ import annotations

import logging
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from bench.diagnosis.comparison import Residual
from bench.diagnosis.result import Candidate, Error, Misfit, Outcome, Step, Value
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects import DarkCurrent, forget_effect_files

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

# Workers get this path, and import what the tests give them to do from it.
sys.path[:0] = [str(Path(__file__).parent / "compute"), str(Path(__file__).parent / "run")]


@pytest.fixture(scope="session")
def cluster_address() -> Iterator[str]:
    """Return the address of a dask cluster of two workers on this machine."""
    import dask
    from distributed import LocalCluster

    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": ":0", "silence_logs": logging.CRITICAL}
    # Over one item two workers may be lost; dask's default is three.
    with dask.config.set({"distributed.scheduler.allowed-failures": 2}), LocalCluster(**options) as cluster:
        yield cluster.scheduler_address


#: An effect as a user writes it.
DIMMER = """\
from dataclasses import dataclass

from sim_backend.pixel.effects import Effect
from sim_backend.pixel.parameters import parameter


@dataclass(frozen=True, slots=True)
class Dimmer(Effect):
    id = "dimmer"
    stage = "light"
    sign = "everything is as under less light"

    share: float = parameter("1", (0.0, 1.0), 0.5, 0.0, "light that is lost")

    def light(self, lux, t_s):
        return lux * (1.0 - self.share)
"""


@pytest.fixture
def dimmer_file(tmp_path: Path) -> Iterator[Path]:
    """Return a file with an effect of a user, `dimmer`, that nothing has loaded; what loads it is undone."""
    file = tmp_path / "dimmer.py"
    file.write_text(DIMMER)
    yield file
    forget_effect_files()


LEVELS_LUX = (0.08, 0.3, 1.0, 10.0, 100.0)
CONTRASTS = (0.2, 0.3, 0.45, 0.8)


def make_residuals(far: float) -> tuple[Residual, ...]:
    """Return residuals: ON responses are `far` sigma too low in the dark, and right from 10 lux on."""
    found = []
    for point, (lux, contrast) in enumerate((e, c) for e in LEVELS_LUX for c in CONTRASTS):
        dark = max(1.0 - math.log10(lux / 0.08) / math.log10(10.0 / 0.08), 0.0)
        for part in ("on", "off"):
            for view in ("response", "latency"):
                z = -far * dark * (1.0 if (part, view) == ("on", "response") else 0.2) + 0.5 * (-1) ** point
                values, unit = ((0.11, 0.97, 0.01), "1") if view == "response" else ((-6.0, -6.5, 0.02), "ln s")
                found.append(Residual(view, part, point, lux, contrast, 0.1, 0.0, *values, z, unit=unit))
    return tuple(found)


@pytest.fixture(scope="session")
def residuals_of() -> Callable[[float], tuple[Residual, ...]]:
    """Make residuals that are so many sigma off in the dark."""
    return make_residuals


def make_step(number: int, added: str | None, error: float, candidates: tuple[Candidate, ...]) -> Step:
    base = {
        "thresholds.on": Value(0.31, 0.302, 0.318, "ln"),
        "source_follower_bandwidth.corner_hz": Value(150.2, 148.0, 152.5, "Hz"),
        "refractory_period.period_s": Value(8.1e-3, 8.0e-3, 8.2e-3, "s"),
    }
    effects = ("thresholds", "noise_floor", "source_follower_bandwidth", "refractory_period", "alignment")
    return Step(
        number=number,
        added=added,
        effects=effects if added is None else (*effects, added),
        error=Error(error, error * 0.005, error * 1.02),
        parameters=base if added is None else {**base, "dark_current.mean_fa": Value(5.52, 5.41, 5.63, "fA")},
        candidates=candidates,
        worst=(Misfit("response_on", 12, 0.08, 0.45, 0.11, 0.97, -88.0),),
    )


@pytest.fixture
def explained() -> Outcome:
    """A diagnosis that found a dark current, which cannot be told from stray light."""
    first = (
        Candidate("dark_current", 30.2, 40.6, 1e-5, ("stray_light",), 0.3, 41.5),
        Candidate("stray_light", 30.1, 40.5, 1e-5, (), 0.012, 41.4),
        Candidate("photoreceptor_bandwidth", 11.0, 14.2, 1e-5, (), None, 13.1),
        Candidate("leak", 0.0, None, 1.0, (), 0.02),
    )
    last = (
        Candidate("leak", 0.04, None, 0.74, (), 0.021),
        Candidate("comparator_delay", 0.01, None, 0.99, (), 1.2e-4),
    )
    return Outcome(
        runs=("2026-11-20-on-family",),
        findings=(),
        steps=(make_step(0, None, 41.7, first), make_step(1, "dark_current", 1.06, last)),
        verdict="explained",
        missing=("dark_current",),
        ties={"dark_current": ("stray_light",)},
        next_measurement={
            "protocol": "on_family",
            "separates": ["dark_current", "stray_light"],
            "minutes": 12.0,
            "separation": 19.0,
        },
        model=PixelModel(theta_on=0.31) + DarkCurrent(mean_fa=5.52),
    )


@pytest.fixture
def nothing_missing() -> Outcome:
    """A diagnosis of a run that the model explains."""
    last = (Candidate("leak", 0.04, None, 0.74, (), 0.021), Candidate("shot_noise", 0.0, None, 1.0, (), None))
    return Outcome(("a-run",), (), (make_step(0, None, 1.02, last),), "nothing_missing", (), {}, model=PixelModel())
