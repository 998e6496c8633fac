"""Which keys a pydantic model knows at some place below it, so that a mistyped one can be told from the right one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, Tag

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["keys_at"]


def keys_at(model: type[BaseModel], loc: Sequence[str | int]) -> list[str]:
    """Return the keys of the model at pydantic's location `loc` below `model`; none if there is no model there."""
    keys: dict[str, None] = {}
    for found in _models_at(model, tuple(loc)):
        keys |= dict.fromkeys(_fields(found))
    return list(keys)


def _fields(model: type[BaseModel]) -> dict[str, Any]:
    """Return the type of each field by the name that stands in a file."""
    return {field.alias or name: field.annotation for name, field in model.model_fields.items()}


def _models_at(annotation: Any, loc: tuple[str | int, ...]) -> Iterator[type[BaseModel]]:
    """Yield the models that can stand at `loc` below a value of type `annotation`."""
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        yield from _models_at(args[0], loc)
    elif origin in (Union, UnionType):
        yield from _union_models(args, loc)
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield from _model(annotation, loc)
    elif isinstance(origin, type) and issubclass(origin, (Sequence, Mapping)) and loc:
        yield from _models_at(_element(origin, args), loc[1:])


def _model(model: type[BaseModel], loc: tuple[str | int, ...]) -> Iterator[type[BaseModel]]:
    if not loc:
        yield model
    elif str(loc[0]) in _fields(model):
        yield from _models_at(_fields(model)[str(loc[0])], loc[1:])


def _element(origin: type, args: tuple[Any, ...]) -> Any:
    if issubclass(origin, Mapping):
        return args[1]
    return args[0]


def _union_models(members: tuple[Any, ...], loc: tuple[str | int, ...]) -> Iterator[type[BaseModel]]:
    """Follow a union: its location begins with the name or tag of a member, unless there is only one besides None."""
    members = tuple(m for m in members if m is not type(None))
    if len(members) == 1:
        yield from _models_at(members[0], loc)
        return
    for member in members:
        if loc and str(loc[0]) in _names(member):
            yield from _models_at(member, loc[1:])


def _names(member: Any) -> set[str]:
    """Return everything by which pydantic may call a member of a union: tag, class, values of a discriminator."""
    if get_origin(member) is Annotated:
        tags = {str(extra.tag) for extra in get_args(member)[1:] if isinstance(extra, Tag)}
        return tags | _names(get_args(member)[0])
    if not (isinstance(member, type) and issubclass(member, BaseModel)):
        return set()
    names = {member.__name__}
    for field in member.model_fields.values():
        if get_origin(field.annotation) is Literal:
            names |= {str(value) for value in get_args(field.annotation)}
    return names
