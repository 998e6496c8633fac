"""The seam of an engine."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np
    import numpy.typing as npt

    from sim_backend.pixel.chain import Chain
    from sim_backend.pixel.light import LightHistory

__all__ = ["Engine"]


class Engine(Protocol):
    """Whatever makes events of a chain, the light and a seed. All engines have the same distribution of events."""

    def events(
        self, chain: Chain, light: LightHistory, duration_s: float, seed: int
    ) -> Iterator[npt.NDArray[np.void]]:
        """Yield the events before `duration_s` as arrays of `EVENT_DTYPE`, in order of time."""
