"""Pixel models for the commands: of a file, or of the four numbers of the base pixel."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim_backend.pixel import PixelModel, read_model_file

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["PixelModel", "base_pixel", "read_model_file"]


def base_pixel(values: Mapping[str, float]) -> PixelModel:
    """Return a pixel without effects; InputError names each value that is out of bounds."""
    return PixelModel.from_dict(values)
