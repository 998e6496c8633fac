"""What the physics tests share: recordings of a few pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np
import pytest

from drivers.events.types import EVENT_DTYPE
from protocols.points import Roi
from sim_backend.pixel import LightHistory, PixelModel, ReferenceEngine, build_chain

if TYPE_CHECKING:
    import numpy.typing as npt


ONE_PIXEL = Roi(0, 0, 1, 1)


class Record(Protocol):
    """Take a recording, and return the events after `wait_s`."""

    def __call__(
        self,
        model: PixelModel,
        light: LightHistory | float,
        duration_s: float,
        *,
        wait_s: float = 0.0,
        roi: Roi = ONE_PIXEL,
        seed: int = 1,
        step: Literal["exact", "euler"] = "exact",
    ) -> npt.NDArray[np.void]: ...


@pytest.fixture(scope="session")
def record() -> Record:
    """Return a function that takes a recording with the reference engine."""

    def take(
        model: PixelModel,
        light: LightHistory | float,
        duration_s: float,
        *,
        wait_s: float = 0.0,
        roi: Roi = ONE_PIXEL,
        seed: int = 1,
        step: Literal["exact", "euler"] = "exact",
    ) -> npt.NDArray[np.void]:
        history = light if isinstance(light, LightHistory) else LightHistory.constant(light)
        engine = ReferenceEngine(step=step)
        chain = build_chain(model, roi, sensor_seed=0)
        parts = [e[e["t"] >= wait_s * 1e6] for e in engine.events(chain, history, wait_s + duration_s, seed)]
        return np.concatenate([np.empty(0, EVENT_DTYPE), *parts])

    return take
