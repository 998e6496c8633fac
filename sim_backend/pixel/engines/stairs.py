"""What the low-pass makes of light in stairs, for a few dark currents."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel.engines.segments import Segments

    Floats = npt.NDArray[np.float64]

__all__ = ["no_stairs", "stairs_of"]


def stairs_of(
    segments: Segments, start_lux: float, dark_lux: Floats, lowest_lux: float, rate: float, rms: float
) -> tuple[Any, ...]:  # fmt: skip
    """Return the tables of the stairs as the kernels take them.

    Parameters are those of :func:`sim_backend.pixel.engines.stairs_kernels.respond`.
    """
    from sim_backend.pixel.engines import stairs_kernels as k

    number = len(segments.lux)
    tables = np.empty((k.TABLES, len(dark_lux), number))
    fastest, window, since = np.empty(number), np.empty(number, np.int64), np.empty(number, np.int64)
    k.respond(
        segments.first, segments.lux, start_lux, dark_lux, lowest_lux, rate, rms, tables, fastest, window, since
    )  # fmt: skip
    return tables, fastest, window, since


def no_stairs() -> tuple[Any, ...]:
    """Return the tables of light that has none."""
    none = np.empty(0, np.int64)
    return np.empty((1, 1, 0)), np.empty(0), none, none
