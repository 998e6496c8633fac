"""What a run shows that a model must give too: each view is one number for each pixel of a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, cast

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from bench.analysis.tally import PointTally
    from bench.store.data import PointData

__all__ = ["RESPONSES", "PixelView", "View", "pixel_views"]

View = Literal["response_on", "response_off", "background_on", "background_off"]

#: Shares of test pulses that are answered; the others are events per pixel and second under constant light.
RESPONSES: Final[tuple[View, View]] = ("response_on", "response_off")


@dataclass(frozen=True, slots=True)
class PixelView:
    """One number for each pixel: a share of test pulses, or a rate of events in Hz."""

    view: View
    log_contrast: float  #: of the test pulse; 0 for background
    width_s: float  #: of the test pulse, s; NaN for background
    pulses: int  #: test pulses for each pixel; 0 for background
    values: npt.NDArray[np.float64]  #: (active pixels,)
    least: float  #: by what one answer, or one event, of one pixel changes its number


def pixel_views(point: PointData, tally: PointTally) -> tuple[PixelView, ...]:
    """Return the views of one point: its groups of test pulses, or the background of constant light.

    There are none where all pixels are masked, no pulse counts, or nothing but gaps was recorded.

    Parameters
    ----------
    point
        Says what was done.
    tally
        What was counted in its events, or in those of a simulation of it.
    """
    active = tally.active
    if not active.any():
        return ()
    if point.waveform == "constant":
        if tally.observed_s <= 0.0:
            return ()
        least = 1.0 / tally.observed_s
        rates = tally.pixel_events[:, active] * least
        return (
            PixelView("background_on", 0.0, np.nan, 0, rates[1], least),
            PixelView("background_off", 0.0, np.nan, 0, rates[0], least),
        )
    return tuple(
        PixelView(
            view=cast("View", f"response_{group.test.polarity}"),
            log_contrast=group.test.log_contrast,
            width_s=group.test.width_s,
            pulses=group.test.pulses,
            values=group.answers[active] / group.test.pulses,
            least=1.0 / group.test.pulses,
        )
        for group in tally.groups
    )
