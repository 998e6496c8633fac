"""Dark current or a slow photoreceptor: at one pulse width they may be tied, with more widths they are told apart.

What is said of one width leads to the other widths, whether the two are tied or nearly so.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from bench.diagnosis.diagnosis import Diagnosis
from bench.diagnosis.expected.catalogue import TWINS
from benchmarks.planted.cases import Case, Plan
from benchmarks.planted.runs import make_run
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects.registry import effect_from_dict

if TYPE_CHECKING:
    from pathlib import Path

PAIR = {
    "dark_current": {"mean_fa": 4.0},
    "photoreceptor_bandwidth": {"hz_per_fa": 6.0, "max_hz": 3000.0},
}
BASE = PixelModel(theta_on=0.28, theta_off=0.3, noise_rms=0.035, corner_hz=250.0, refractory_s=3e-3)
ONE = Plan((0.1, 100.0), (0.15, 0.2, 0.25, 0.3, 0.36, 0.44, 0.55, 0.7, 1.0), (), long_s=0.05, constant_s=4.0)
OTHER_WIDTHS_S = (0.005, 0.15)


@pytest.mark.slow
@pytest.mark.dozen
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("truth", PAIR)
def test_other_widths_tell_dark_current_from_a_slow_photoreceptor(tmp_path: Path, truth: str) -> None:
    (other,) = PAIR.keys() - {truth}
    model = BASE + effect_from_dict(truth, PAIR[truth])
    case = Case("single", 0, 4711, model, (), False, 1e-5, ONE)
    run = make_run(case, tmp_path / "one")
    with Diagnosis(run) as diagnosis:
        outcome = diagnosis.run()
    assert truth in outcome.missing or truth in outcome.ties.get(other, ())
    if truth == "dark_current":
        assert outcome.next_measurement is not None
        assert outcome.next_measurement["protocol"] == "pulse_width"

    more = []
    for number, width_s in enumerate(OTHER_WIDTHS_S, start=1):
        plan = replace(ONE, long=(0.25, 0.36, 0.55, 1.0), long_s=width_s)
        more.append(make_run(replace(case, number=number, plan=plan), tmp_path / f"{width_s}"))
    with Diagnosis([run, *more]) as diagnosis:
        outcome = diagnosis.run()
    assert outcome.missing == (truth,)
    assert set(outcome.ties.get(truth, ())) <= {TWINS.get(truth)}
