"""A pixel model from the numbers that characterisation found."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sim_backend.pixel import PixelModel
from sim_backend.pixel.model_file import model_text

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["characterized_model_text"]


def characterized_model_text(numbers: Mapping[str, Any]) -> str:
    """Return the text of a model file; InputError names each number that no pixel can have."""
    return model_text(PixelModel.from_dict(dict(numbers)))
