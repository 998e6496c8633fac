"""`evs-bench effects`: the physical effects that a pixel model may have."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from bench.commands.common import effects_option, json_option, print_json, print_table

if TYPE_CHECKING:
    from bench.models.effects import EffectDescription, Parameter

__all__ = ["command"]


@click.command(name="effects")
@click.argument("name", required=False)
@effects_option
@json_option
def command(name: str | None, as_json: bool) -> None:
    """List the physical effects that a pixel model may have, or explain the effect NAME."""
    from bench.models.effects import describe, described_effects

    if name is None:
        _list(described_effects(), as_json)
    else:
        _explain(describe(name), as_json)


def _list(found: tuple[EffectDescription, ...], as_json: bool) -> None:
    if as_json:
        print_json({"format": "evs-bench-effects/1", "effects": [_as_dict(effect) for effect in found]})
        return
    rows = [(e.id, e.stage, ", ".join(p.name for p in e.parameters)) for e in found]
    print_table(("name", "stage", "parameters"), rows)


def _explain(effect: EffectDescription, as_json: bool) -> None:
    if as_json:
        print_json({"format": "evs-bench-effect/1", **_as_dict(effect)})
        return
    click.echo(
        f"{effect.id}, stage: {effect.stage}, {_origin(effect)}\n\n{effect.text}\n\nFirst sign: {effect.sign}\n"
    )
    header = ("parameter", "unit", "lowest", "highest", "default", "null", "meaning")
    print_table(header, [_row(parameter) for parameter in effect.parameters])


def _origin(effect: EffectDescription) -> str:
    return effect.source if effect.source == "built in" else f"from {effect.source}"


def _row(p: Parameter) -> tuple[str, ...]:
    null = "-" if p.null is None else f"{p.null:g}"
    default = "open" if p.default is None else f"{p.default:g}"
    return (p.name, p.unit, f"{p.bounds[0]:g}", f"{p.bounds[1]:g}", default, null, p.doc)


def _as_dict(effect: EffectDescription) -> dict[str, Any]:
    return {
        "id": effect.id,
        "stage": effect.stage,
        "source": effect.source,
        "summary": effect.summary,
        "text": effect.text,
        "sign": effect.sign,
        "parameters": [_parameter_as_dict(p) for p in effect.parameters],
    }


def _parameter_as_dict(p: Parameter) -> dict[str, Any]:
    lowest, highest = p.bounds
    return {
        "name": p.name,
        "unit": p.unit,
        "lowest": lowest,
        "highest": None if math.isinf(highest) else highest,
        "default": p.default,
        "null": "infinite" if p.null == math.inf else p.null,
        "meaning": p.doc,
    }
