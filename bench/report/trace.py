"""The trace of a model, as the report draws it beside the events of one pixel."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

__all__ = ["ModelTrace"]


class ModelTrace(NamedTuple):
    """What a model says of the change detector of the example pixel.

    :func:`bench.report.example.choose_example` says which pixel of which point that is. The report always labels it
    as a model, never as a measurement.
    """

    t_s: npt.NDArray[np.float64]  #: (n,) s, ascending, in the time of the recording
    difference_ln: npt.NDArray[np.float64]  #: (n,) V - V_ref, ln units
    theta_on: float = float("nan")  #: ON threshold of the model, ln units; NaN draws no line
    theta_off: float = float("nan")  #: OFF threshold of the model, ln units; NaN draws no line
