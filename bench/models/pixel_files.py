"""Pixel models for the commands: of a file, or of the four numbers of the base pixel."""

from __future__ import annotations

from typing import TYPE_CHECKING

from protocols.errors import InputError
from sim_backend.pixel import PixelModel, read_model_file
from sim_backend.pixel.model_file import model_text

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

__all__ = ["PixelModel", "base_pixel", "read_model_file", "write_model_file"]


def base_pixel(values: Mapping[str, float]) -> PixelModel:
    """Return a pixel without effects; InputError names each value that is out of bounds."""
    return PixelModel.from_dict(values)


def write_model_file(path: Path, model: PixelModel) -> None:
    """Write a pixel model to a file; InputError where that is not possible."""
    try:
        path.write_text(model_text(model), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None
