"""What all parts of a protocol file have in common: the base model, quantities, and problems with a place."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel, ConfigDict, Field
from pydantic_core import PydanticCustomError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from pydantic import GetJsonSchemaHandler
    from pydantic.json_schema import JsonSchemaValue
    from pydantic_core import CoreSchema

__all__ = [
    "CLASS_PATTERN",
    "NAME_PATTERN",
    "PROBLEMS_AT",
    "Contrast",
    "Frequency",
    "FrozenModel",
    "Illuminance",
    "LogThreshold",
    "Number",
    "PathProblem",
    "Seconds",
    "WaitingTime",
    "problems_at",
]

PathProblem = tuple[tuple[str | int, ...], str]
"""A path below a model, and what is wrong there."""

NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_.-]*$"
"""A name that can be part of a file name; :mod:`protocols.explain` says it in words."""

CLASS_PATTERN = r"^[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*$"
"""The path of a class; :mod:`protocols.explain` says it in words."""

PROBLEMS_AT = "problems_at"
"""Type of the pydantic error that carries problems with their own paths."""


class FrozenModel(BaseModel):
    """A part of a file that a user writes: unknown keys are refused, and nothing changes once it is read."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Describe each field by the text below it: read here, because pydantic would read it at every start."""
        from protocols.attribute_texts import texts_below_fields

        schema = handler(core_schema)
        properties = handler.resolve_ref_schema(schema).get("properties", {})
        for name, text in texts_below_fields(cls).items():
            if (field := cls.model_fields.get(name)) is not None:
                properties[field.alias or name].setdefault("description", text)
        return schema


def problems_at(problems: Iterable[PathProblem]) -> PydanticCustomError:
    """Return an error for a validator to raise, which says what is wrong where below its own place.

    Parameters
    ----------
    problems
        For each problem the path from the model or value that is being validated, and a message.
    """
    found = list(problems)
    text = "; ".join(f"{'.'.join(map(str, path))}: {message}" if path else message for path, message in found)
    context: dict[str, Any] = {"text": text, "problems": found}
    return PydanticCustomError(PROBLEMS_AT, "{text}", context)


# Numbers are strict: true is not 1, and the text '5' is not 5. Upper bounds are far beyond any bench; they keep
# what is computed from a mistyped value finite.
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Seconds = Annotated[float, Field(strict=True, gt=0, le=1e5, allow_inf_nan=False)]
WaitingTime = Annotated[float, Field(strict=True, ge=0, le=1e5, allow_inf_nan=False)]
Illuminance = Annotated[float, Field(strict=True, ge=0, le=1e6, allow_inf_nan=False)]
Contrast = Annotated[float, Field(strict=True, gt=0, le=1e6, allow_inf_nan=False)]
LogThreshold = Annotated[float, Field(strict=True, ge=0.01, le=5, allow_inf_nan=False)]
Frequency = Annotated[float, Field(strict=True, gt=0, le=1e7, allow_inf_nan=False)]
