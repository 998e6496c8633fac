"""What the report says of the settings that were asked."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.report.facts import facts_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

THRESHOLDS = {"on": 0.3, "off": 0.25}
ASKED = {"thresholds": THRESHOLDS, "refractory_period_s": 0.01, "bandwidth_hz": 200.0, "biases": {"bias_fo": -5}}
TOLD = "thresholds ON 0.3 ln, thresholds OFF 0.25 ln, refractory period 10 ms, bandwidth 200 Hz, biases bias_fo -5"


def _asked(run_of: Callable[..., Any], *measurements: dict[str, Any]) -> list[str]:
    run = run_of("title", protocol={"measurements": list(measurements)})
    return [fact.value for fact in facts_of(run).facts if fact.name == "Settings asked"]


def test_settings_have_their_units(constant_run_of: Callable[..., Any]) -> None:
    assert _asked(constant_run_of, {"name": "bright", "settings": ASKED}) == [TOLD]


def test_settings_that_differ_say_for_which_measurements(constant_run_of: Callable[..., Any]) -> None:
    slow = {"bandwidth_hz": 50.0}
    asked = _asked(
        constant_run_of,
        {"name": "bright", "settings": ASKED},
        {"name": "slow", "settings": slow},
        {"name": "dim", "settings": ASKED},
    )
    assert asked == [f"bright, dim: {TOLD}", "slow: bandwidth 50 Hz"]
