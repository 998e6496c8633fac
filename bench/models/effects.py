"""What is to be known about the effects that a pixel model may have."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sim_backend.pixel.effects import STAGES, effect_class, effect_source, effects
from sim_backend.pixel.parameters import Parameter

if TYPE_CHECKING:
    from sim_backend.pixel.effects import Effect

__all__ = ["EffectDescription", "Parameter", "describe", "described_effects"]


@dataclass(frozen=True, slots=True)
class EffectDescription:
    """An effect in words: what it is, what it does, and its parameters."""

    id: str  #: the name in files
    stage: str  #: where in the chain it acts
    summary: str  #: what it is, in one line
    text: str  #: equation and source, several lines
    sign: str  #: what it does to what can be measured
    parameters: tuple[Parameter, ...]
    source: str  #: "built in", or the file or package that it comes from


def describe(effect_id: str) -> EffectDescription:
    """Return what is to be known about the effect of that id.

    Raises
    ------
    InputError
        There is none; the message names the nearest.
    """
    return _described(effect_class(effect_id))


def described_effects() -> tuple[EffectDescription, ...]:
    """Return all known effects in the order in which a signal passes them; those of plug-ins and of files too."""
    found = sorted(effects().values(), key=lambda effect: STAGES.index(effect.stage))
    return tuple(_described(effect) for effect in found)


def _described(effect: type[Effect]) -> EffectDescription:
    text = inspect.getdoc(effect) or ""
    source = effect_source(effect.id)
    return EffectDescription(
        id=effect.id,
        stage=effect.stage,
        summary=text.partition("\n")[0],
        text=text,
        sign=effect.sign,
        parameters=effect.parameters(),
        source="built in" if source is None else source.package or source.name,
    )
