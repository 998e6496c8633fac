"""What a protocol refuses, and in which words."""

from __future__ import annotations

import copy
from typing import Any

import pytest
import yaml
from pydantic import ValidationError

from protocols.errors import InputError
from protocols.files import parse_model
from protocols.schema import Protocol

BASE: dict[str, Any] = {
    "format": "evs-bench-protocol/1",
    "title": "t",
    "roi": {"x": 0, "y": 0, "width": 4, "height": 4},
    "expect": {"dark_light_lux": 0.146, "theta_on": 0.3, "theta_off": 0.25},
    "pulses": 10,
    "measurements": [
        {
            "name": "rt",
            "stimulus": {
                "kind": "reset_test",
                "polarity": "on",
                "reset_s": 0.1,
                "test_s": 0.1,
                "reset_contrast": {"scale": "linear", "value": 0.5},
            },
            "sweep": {"illuminance_lux": [1, 10], "contrast": {"scale": "log", "values": [0.2, 0.3]}},
        },
        {
            "name": "sq",
            "stimulus": {"kind": "square", "frequency_hz": 5},
            "sweep": {"illuminance_lux": 1, "contrast": {"scale": "log", "values": [0.2]}},
        },
        {
            "name": "dc",
            "stimulus": {"kind": "constant", "duration_s": 5},
            "sweep": {"illuminance_lux": {"logspace": {"start": 0.1, "stop": 10, "num": 3}}},
        },
    ],
}

RT, SQ, DC = "measurements.0", "measurements.1", "measurements.2"


def changed(changes: dict[str, Any]) -> dict[str, Any]:
    """Return the base with values put in (or, for ..., taken out) at dotted paths."""
    data = copy.deepcopy(BASE)
    for path, value in changes.items():
        *parents, last = path.split(".")
        node: Any = data
        for part in parents:
            node = node[int(part)] if isinstance(node, list) else node[part]
        if value is ...:
            del node[last]
        else:
            node[last] = value
    return data


def problems(changes: dict[str, Any]) -> list[str]:
    text = yaml.safe_dump(changed(changes), sort_keys=False)
    with pytest.raises(InputError) as caught:
        parse_model(text, Protocol, "f.yaml")
    assert all(p.line > 0 and p.column > 0 and p.file == "f.yaml" for p in caught.value.problems)
    return [p.message for p in caught.value.problems]


def test_the_base_is_fine() -> None:
    protocol = parse_model(yaml.safe_dump(BASE), Protocol, "f.yaml")
    assert [m.name for m in protocol.measurements] == ["rt", "sq", "dc"]
    assert len(protocol.expand()) == 4 + 1 + 3


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "evs-bench-protocol/2"}, "format: 'evs-bench-protocol/2' is not 'evs-bench-protocol/1'"),
        ({"seed": -1}, "seed: -1 is out of range, must be at least 0"),
        ({"seed": True}, "seed: true is not a whole number"),
        ({"pulses": 2.5}, "pulses: 2.5 is not a whole number"),
        ({"pulses": "10"}, "pulses: '10' is not a whole number"),
        ({"measurements": []}, "measurements: must have at least 1 item"),
        ({"expect": {}}, "expect: key 'dark_light_lux' is missing"),
        (
            {f"{SQ}.name": "s q"},
            "measurements[1].name: must be letters, digits, '_', '.' and '-', and begin with a letter or digit",
        ),
        ({f"{SQ}.name": "rt"}, "measurements[1].name: the name 'rt' is given twice"),
        ({f"{SQ}.stimulus.duty": 1}, "measurements[1].stimulus.duty: 1 is out of range, must be below 1"),
        (
            {f"{SQ}.stimulus.frequency_hz": float("inf")},
            "measurements[1].stimulus.frequency_hz: inf is not a finite number",
        ),
        (
            {"settings": {"long_refractory_period": 0.01}},
            "settings.long_refractory_period: unknown key, did you mean 'long_refractory_period_s'?",
        ),
        (
            {"settings": {"long_refractory_period_s": "10 ms"}},
            "settings.long_refractory_period_s: '10 ms' is not a number",
        ),
        (
            {"settings": {"long_refractory_period_s": 0.01, "refractory_period_s": 0.02}},
            "settings.refractory_period_s: is the same setting as long_refractory_period_s, give one",
        ),
        (
            {"settings": {"imbalanced_thresholds": {"on": 0.3, "off": 0.3}}},
            "settings.imbalanced_thresholds: on and off are equal; if that is meant, write thresholds",
        ),
        ({"settings": {"biases": {"bias_fo": 1.5}}}, "settings.biases.bias_fo: 1.5 is not a whole number"),
        (
            {f"{RT}.sweep.contrast": {"scale": "log", "values": [1], "linspace": {"start": 1, "stop": 2, "num": 2}}},
            "measurements[0].sweep.contrast: needs one of values, linspace and logspace, not values and linspace",
        ),
        (
            {f"{RT}.sweep.contrast": {"scale": "log", "linspace": {"start": 0, "stop": 2, "num": 2}}},
            "measurements[0].sweep.contrast.linspace: contrasts must be above 0",
        ),
        (
            {f"{RT}.sweep.illuminance_lux": "bright"},
            "measurements[0].sweep.illuminance_lux: must be a number, a list of numbers, "
            "{linspace: {start, stop, num}} or {logspace: {start, stop, num}}",
        ),
        (
            {f"{RT}.sweep.illuminance_lux": [1, -2]},
            "measurements[0].sweep.illuminance_lux[1]: -2 is out of range, must be at least 0",
        ),
        (
            {f"{RT}.sweep.illuminance_lux": {"linspace": {"start": -1, "stop": 1, "num": 3}}},
            "measurements[0].sweep.illuminance_lux: -1 is out of range, must be at least 0",
        ),
        (
            {f"{RT}.sweep.illuminance_lux": 0},
            "measurements[0].sweep.illuminance_lux: must be above 0 where there is a contrast",
        ),
        ({f"{RT}.sweep.contrast": ...}, "measurements[0].sweep: key 'contrast' is missing"),
        ({"pulses": ..., f"{SQ}.pulses": 3}, "measurements[0]: key 'pulses' is missing, here and in the protocol"),
        (
            {f"{RT}.stimulus.polarity": ...},
            "measurements[0].stimulus: key 'polarity' is missing, and no 'polarity' is swept",
        ),
        (
            {f"{RT}.sweep.polarity": ["on"]},
            "measurements[0].sweep.polarity: is swept, so 'polarity' of the stimulus must be left out",
        ),
        (
            {f"{RT}.stimulus.polarity": ..., f"{RT}.sweep.polarity": ["on", "on"]},
            "measurements[0].sweep.polarity[1]: polarity 'on' is given twice",
        ),
        (
            {f"{RT}.stimulus.test_s": ...},
            "measurements[0].stimulus: key 'test_s' is missing, and no 'pulse_width_s' is swept",
        ),
        (
            {f"{RT}.stimulus.window_s": 0.3},
            "measurements[0].stimulus.window_s: 0.3 s reaches into the next reset pulse, which begins 0.2 s after "
            "the leading edge of the test pulse",
        ),
        (
            {f"{RT}.stimulus.reset_contrast": {"scale": "linear", "by_level": [{"illuminance_lux": 1, "value": 1}]}},
            "measurements[0].stimulus.reset_contrast.by_level: there is no contrast for 10 lux",
        ),
        (
            {f"{RT}.stimulus.reset_contrast": {"scale": "linear"}},
            "measurements[0].stimulus.reset_contrast: needs one of value and by_level",
        ),
        (
            {f"{RT}.sweep.contrast.values": [20]},
            "measurements[0].sweep.contrast: a log contrast of 20 is out of range, must be at most 15",
        ),
        (
            {"expect": ..., f"{RT}.sweep.contrast.scale": "threshold"},
            "measurements[0].sweep.contrast.scale: the threshold scale needs dark_light_lux: give it under expect",
        ),
        (
            {"expect": {"dark_light_lux": 0.1}, f"{RT}.stimulus.reset_contrast.scale": "threshold"},
            "measurements[0].stimulus.reset_contrast.scale: the threshold scale needs theta_on: give it under "
            "settings or expect",
        ),
        (
            {
                f"{RT}.stimulus.polarity": "off",
                f"{RT}.sweep.illuminance_lux": 0.03,
                f"{RT}.sweep.contrast.scale": "threshold",
            },
            "measurements[0].sweep.contrast: from 0.03 lux even darkness and back is less than the OFF threshold of "
            "0.25: with a dark light of 0.146 lux the level must be above 0.0415 lux",
        ),
        (
            {f"{SQ}.sweep.polarity": ["on"]},
            "measurements[1].sweep.polarity: a square wave always shows both polarities",
        ),
        (
            {f"{SQ}.stimulus.frequency_hz": ...},
            "measurements[1].stimulus: key 'frequency_hz' is missing, and no 'pulse_width_s' is swept",
        ),
        ({f"{DC}.pulses": 5}, "measurements[2].pulses: constant light has no pulses"),
        (
            {f"{DC}.sweep.contrast": {"scale": "log", "values": [1]}},
            "measurements[2].sweep.contrast: constant light has no pulses",
        ),
        (
            {f"{DC}.sweep.nd_od": "none"},
            "measurements[2].sweep.nd_od: must be an optical density, a list of them, or {od, below_lux}",
        ),
        (
            {f"{DC}.sweep.nd_od": {"od": 3, "below": 1}},
            "measurements[2].sweep.nd_od.below: unknown key, did you mean 'below_lux'?",
        ),
        ({f"{DC}.ambient": "dark"}, "measurements[2].ambient: 'dark' is not one of open, shrouded, capped"),
        ({f"{DC}.operator": {"before": ""}}, "measurements[2].operator.before: must not be empty"),
        (
            {f"{DC}.sweep.bandwidth_hz": {"linspace": {"start": 1, "stop": 2, "num": 99_999}}},
            "measurements: these are 300002 points, at most 100000 are allowed",
        ),
    ],
)
def test_each_mistake_is_one_line(changes: dict[str, Any], message: str) -> None:
    assert problems(changes) == [message]


def test_all_that_does_not_go_together_is_named_at_once() -> None:
    found = problems({f"{RT}.stimulus.window_s": 5, f"{SQ}.name": "rt", f"{DC}.pulses": 5})
    assert len(found) == 3


def test_a_protocol_can_be_made_in_python_and_is_frozen() -> None:
    protocol = Protocol.model_validate(BASE)
    with pytest.raises(ValidationError):
        protocol.seed = 3  # type: ignore[misc]
    with pytest.raises(ValidationError, match="is given twice"):
        Protocol.model_validate(changed({f"{SQ}.name": "rt"}))


def test_on_and_off_are_text() -> None:
    text = yaml.safe_dump(BASE).replace("polarity: 'on'", "polarity: off")
    assert "polarity: off" in text
    assert parse_model(text, Protocol, "f.yaml").expand()[0].polarity == "off"
