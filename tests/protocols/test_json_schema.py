"""The JSON Schema for editors accepts what the bench accepts, and refuses gross mistakes.

The part of JSON Schema that it uses is interpreted here, independently of pydantic.
"""

from __future__ import annotations

import copy
import json
from typing import Any

import pytest

from protocols import library
from protocols.json_schema import protocol_json_schema
from protocols.yaml_strict import read_yaml

SCHEMA = protocol_json_schema()

_TYPES: dict[str, tuple[type, ...]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "integer": (int,),
    "number": (int, float),
    "boolean": (bool,),
    "null": (type(None),),
}
_KNOWN = {
    *("$defs", "$schema", "title", "description", "default", "examples", "discriminator"),
    *("$ref", "type", "const", "enum", "anyOf", "oneOf", "properties", "required", "additionalProperties", "items"),
    *("minItems", "minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum", "minLength", "maxLength", "pattern"),
}


def fits(value: Any, schema: dict[str, Any], root: dict[str, Any]) -> bool:
    """Tell whether `value` has the structure that `schema` asks for."""
    assert set(schema) <= _KNOWN, set(schema) - _KNOWN
    if "$ref" in schema:
        return fits(value, root["$defs"][schema["$ref"].removeprefix("#/$defs/")], root)
    if "anyOf" in schema and not any(fits(value, s, root) for s in schema["anyOf"]):
        return False
    if "oneOf" in schema and sum(fits(value, s, root) for s in schema["oneOf"]) != 1:
        return False
    return _simple(value, schema) and _inside(value, schema, root)


def _simple(value: Any, schema: dict[str, Any]) -> bool:
    if "type" in schema:
        right_type = isinstance(value, _TYPES[schema["type"]])
        if not right_type or (isinstance(value, bool) and schema["type"] != "boolean"):
            return False
    if "const" in schema and value != schema["const"]:
        return False
    if "enum" in schema and value not in schema["enum"]:
        return False
    return not isinstance(value, (int, float)) or (
        value >= schema.get("minimum", value)
        and value <= schema.get("maximum", value)
        and ("exclusiveMinimum" not in schema or value > schema["exclusiveMinimum"])
        and ("exclusiveMaximum" not in schema or value < schema["exclusiveMaximum"])
    )


def _inside(value: Any, schema: dict[str, Any], root: dict[str, Any]) -> bool:
    if isinstance(value, list):
        enough = len(value) >= schema.get("minItems", 0)
        return enough and all(fits(item, schema["items"], root) for item in value if "items" in schema)
    if isinstance(value, dict) and schema.get("type") == "object":
        if not set(schema.get("required", ())) <= set(value):
            return False
        return all(_key_fits(key, item, schema, root) for key, item in value.items())
    return True


def _key_fits(key: str, item: Any, schema: dict[str, Any], root: dict[str, Any]) -> bool:
    if key in schema.get("properties", {}):
        return fits(item, schema["properties"][key], root)
    more = schema.get("additionalProperties", True)
    return fits(item, more, root) if isinstance(more, dict) else bool(more)


@pytest.mark.parametrize("name", library.names())
def test_ready_made_files_have_the_structure(name: str) -> None:
    assert fits(read_yaml(library.text(name), name).value, SCHEMA, SCHEMA)


@pytest.mark.parametrize(
    "axis",
    [5, [1, 2.5], {"linspace": {"start": 1, "stop": 2, "num": 3}}, {"logspace": {"start": 1, "stop": 2, "num": 3}}],
)
def test_every_form_of_an_axis_has_the_structure(axis: Any) -> None:
    value = read_yaml(library.text("quick_look"), "quick_look").value
    value["measurements"][0]["sweep"]["illuminance_lux"] = axis
    assert fits(value, SCHEMA, SCHEMA)


@pytest.mark.parametrize(
    ("path", "wrong"),
    [
        (("seed",), "one"),
        (("pulses",), 0),
        (("unknown",), 1),
        (("roi", "width"), 0),
        (("measurements", 0, "stimulus", "kind"), "triangle"),
        (("measurements", 0, "sweep", "illuminance_lux"), {"linspace": {"start": 1, "stop": 2}}),
        (("measurements", 0, "sweep", "contrast", "scale"), "decibel"),
    ],
)
def test_gross_mistakes_do_not(path: tuple[str | int, ...], wrong: Any) -> None:
    value = copy.deepcopy(read_yaml(library.text("quick_look"), "quick_look").value)
    node = value
    for part in path[:-1]:
        node = node[part]
    node[path[-1]] = wrong
    assert not fits(value, SCHEMA, SCHEMA)


def test_it_is_json_and_says_what_each_key_means() -> None:
    assert json.loads(json.dumps(SCHEMA)) == SCHEMA
    assert SCHEMA["title"] == "EVS bench protocol"
    models = [SCHEMA, *SCHEMA["$defs"].values()]
    for model in models:
        assert model["description"]
        for key, field in model["properties"].items():
            if "$ref" not in field and key not in ("linspace", "logspace"):
                assert field.get("description"), key
