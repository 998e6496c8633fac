"""Each fault of each instrument once in a whole run; `benchmarks/wire_faults.py` puts them at every request."""

from __future__ import annotations

import pytest

from benchmarks.wire_faults import FAULTS, Trial, take

#: Where in a run: while connecting, or in the middle of it.
_AT = {"led_driver": 8, "rs7": 40, "wheel": 9, "camera": 700}
TRIALS = [
    Trial(station, instrument, fault, _AT[instrument])
    for (station, instrument), faults in FAULTS.items()
    for fault in faults
]


@pytest.mark.slow
@pytest.mark.parametrize("trial", TRIALS, ids=lambda t: t.name.replace(" ", "-"))
def test_the_light_ends_dark_and_no_point_is_damaged(trial: Trial) -> None:
    verdict = take(trial)
    assert verdict.dark
    assert verdict.damaged == 0
    assert verdict.finished or verdict.told
    device = {"wheel": "filter wheel", "camera": "camera"}.get(trial.instrument, "light source")
    assert not verdict.told or device in verdict.told
