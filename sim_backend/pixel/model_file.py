"""A pixel model in a file of its own: YAML, format `evs-bench-model/1`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import yaml

from protocols.errors import InputError, Problem
from protocols.files import read_text
from protocols.yaml_strict import read_yaml
from sim_backend.pixel.model import PixelModel

if TYPE_CHECKING:
    import os

__all__ = ["MODEL_FORMAT", "model_text", "read_model_file"]

MODEL_FORMAT: Final = "evs-bench-model/1"


def read_model_file(path: str | os.PathLike[str]) -> PixelModel:
    """Return the pixel model in the file `path`.

    Raises
    ------
    InputError
        The file cannot be read, is of another format, or something in it is unknown or out of bounds.
    """
    source = str(path)
    value = read_yaml(read_text(path), source).value
    if not isinstance(value, dict) or value.get("format") != MODEL_FORMAT:
        raise InputError(Problem(f"is no pixel model; expected 'format: {MODEL_FORMAT}'", source))
    try:
        return PixelModel.from_dict({name: item for name, item in value.items() if name != "format"})
    except InputError as error:
        raise InputError(*(Problem(p.message, source) for p in error.problems)) from None


def model_text(model: PixelModel) -> str:
    """Return the model as the text of such a file."""
    return yaml.safe_dump({"format": MODEL_FORMAT, **model.to_dict()}, sort_keys=False)
