"""Files that a user writes: strict YAML into a pydantic model, with a place for each problem."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from pydantic import BaseModel, ValidationError

from protocols.errors import InputError, Problem
from protocols.explain import explain
from protocols.yaml_strict import MOST_CHARACTERS, read_yaml

if TYPE_CHECKING:
    import os

__all__ = ["parse_model", "read_model", "read_text"]

M = TypeVar("M", bound=BaseModel)


def read_model(path: str | os.PathLike[str], model: type[M]) -> M:
    """Return the file `path` as a `model`.

    Raises
    ------
    InputError
        If the file cannot be read, or with everything that is wrong in it, each with line and column.
    """
    return parse_model(read_text(path), model, str(path))


def parse_model(text: str, model: type[M], source: str) -> M:
    """Return `text` as a `model`.

    Parameters
    ----------
    text
        One YAML document; see :mod:`protocols.yaml_strict`.
    model
        Any pydantic model. Keys that it forbids, values that are out of range and its own validators' complaints
        become problems.
    source
        Name of the file, for messages.

    Raises
    ------
    InputError
        With everything that is wrong, in the order of the file.
    """
    document = read_yaml(text, source)
    try:
        return model.model_validate(document.value)
    except ValidationError as error:
        problems = explain(error, model, document, source)
    raise InputError(*problems)


def read_text(path: str | os.PathLike[str]) -> str:
    """Return the text of a file that a user wrote: UTF-8, and no longer than a person would write.

    Raises
    ------
    InputError
        If it is not there, cannot be read, is too long, or is not text.
    """
    source = str(path)
    try:
        with Path(path).open("rb") as file:
            data = file.read(4 * MOST_CHARACTERS + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(Problem(f"cannot be read: {reason}", source)) from None
    if len(data) > 4 * MOST_CHARACTERS:
        raise InputError(Problem(f"has more than {4 * MOST_CHARACTERS} bytes", source))
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        column = error.start - data.rfind(b"\n", 0, error.start)
        raise InputError(Problem("is not UTF-8 text", source, line, column)) from None
