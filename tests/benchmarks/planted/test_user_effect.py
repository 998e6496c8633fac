"""The documentation's own effect, planted: unexplained without its file, named with it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from bench.diagnosis.diagnosis import Diagnosis
from benchmarks.planted.cases import Case, Plan
from benchmarks.planted.runs import make_run
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects import effect_class, forget_effect_files, load_effect_files

if TYPE_CHECKING:
    from collections.abc import Iterator

DOCUMENT = Path(__file__).resolve().parents[3] / "docs" / "how-to" / "write-an-effect.md"
HALF_FA = 20.0
#: In short pulses at 0.08 lux the dead time is longer than half a period. Few points: it goes sample by sample.
PLAN = Plan((0.08, 100.0), (0.25, 0.35, 0.7), (0.35, 0.7), long_periods=8, short_periods=16, constant_s=3.0)


@pytest.fixture
def effect_file(tmp_path: Path) -> Iterator[Path]:
    found = re.search(r"^# file: my_effect.py\n(.*?)^```", DOCUMENT.read_text(), re.MULTILINE | re.DOTALL)
    assert found is not None
    path = tmp_path / "my_effect.py"
    path.write_text(found[1])
    yield path
    forget_effect_files()


@pytest.mark.slow
@pytest.mark.dozen
@pytest.mark.timeout(3000)
def test_an_effect_of_ones_own_is_found_once_it_is_known(tmp_path: Path, effect_file: Path) -> None:
    load_effect_files([effect_file])
    planted = effect_class("light_refractory")(half_fa=HALF_FA)  # type: ignore[call-arg]
    model = PixelModel(theta_on=0.3, theta_off=0.26, noise_rms=0.04, corner_hz=200.0, refractory_s=3e-3) + planted
    run = make_run(Case("outside", 0, 77, model, (), True, 17.3e-6, PLAN), tmp_path / "run")

    forget_effect_files()
    with Diagnosis(run, workers=2) as unaware:  # all candidates are tried in full: the longest test by far
        outcome = unaware.run()
    assert outcome.verdict == "unexplained"
    assert outcome.missing == ()

    load_effect_files([effect_file])
    with Diagnosis(run) as aware:
        outcome = aware.run(most=1)
    assert outcome.missing == ("light_refractory",)
    assert outcome.verdict == "explained"
