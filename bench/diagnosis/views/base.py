"""The seam of a view: what it sees, and what it says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np
    import numpy.typing as npt

    from bench.diagnosis.recorded.recording import Recording

__all__ = ["Kind", "Part", "Statistic", "View"]

#: A share of trials; a number of events for each unit of the bottom; a mean over events; anything else.
Kind = Literal["share", "count", "mean", "difference"]
Part = Literal["on", "off", "both"]


@dataclass(frozen=True, slots=True)
class Statistic:
    """One number about a recording: a sum over clusters divided by another.

    Clusters are independent of each other in the model: pixels as a rule, or the pulses of a recording for what all
    pixels have in common. The uncertainty of the number follows from the scatter between clusters, so nothing is
    assumed of pulses of one pixel.
    """

    part: Part
    kind: Kind
    top: npt.NDArray[np.float64]  #: (clusters,)
    bottom: npt.NDArray[np.float64]  #: (clusters,)
    log_contrast: float = 0.0  #: of the test pulse; 0 for background
    width_s: float = float("nan")  #: of the test pulse; NaN for background
    by_pulse: bool = False  #: the clusters are pulses, not pixels
    least: float = 0.0  #: what one rare event changes the number by: it is not known better
    of_pairs: bool = False
    """It is a mean over pixels of products of two of their answers, each less its mean, and `least` is one by the
    number of pairs: answers of probability p that had nothing in common would give it a variance of
    ``least (p (1 - p))^2``. The response to the same pulses is looked up: `part`, `log_contrast` and `width_s` are
    those of the answers."""


class View:
    """Looks at one recording in one way. A subclass sets `id`, `title` and `unit`, and implements :meth:`look`."""

    id: ClassVar[str]  #: the name in files
    title: ClassVar[str]  #: what it shows, for an axis
    unit: ClassVar[str] = "1"
    """Of its numbers. Those in ``ln s`` or ``ln us``, the logarithm of a time, are told as that time."""
    of_array: ClassVar[bool] = False
    """What it shows depends on how many pixels there are: it looks at whole sensors only, one by one."""
    fitted: ClassVar[bool] = True
    """Fits and searches go by it. Else `compare` alone shows it: for the eye, where other views tell as much in fewer
    numbers."""

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield what this view has to say about a recording, always the same statistics for the same frame.

        Of several sensors the clusters of the first come before those of the next.

        Raises
        ------
        NotImplementedError
            The view is not complete.
        """
        raise NotImplementedError(f"view {self.id}: look() is missing")
