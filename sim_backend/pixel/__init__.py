"""The pixel: its model, its effects, and the engines that make events of them."""

from __future__ import annotations

from sim_backend.pixel.chain import Chain, build_chain
from sim_backend.pixel.engines.fast import FastEngine
from sim_backend.pixel.engines.reference import ReferenceEngine
from sim_backend.pixel.light import LightHistory
from sim_backend.pixel.model import Photoconversion, PixelModel
from sim_backend.pixel.model_file import model_text, read_model_file
from sim_backend.pixel.parameters import Parameter

__all__ = [
    "Chain",
    "FastEngine",
    "LightHistory",
    "Parameter",
    "Photoconversion",
    "PixelModel",
    "ReferenceEngine",
    "build_chain",
    "model_text",
    "read_model_file",
]
