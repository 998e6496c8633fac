"""How often pulses are answered, and what else happens in their windows."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from bench.diagnosis.views.base import Statistic, View

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from bench.diagnosis.recorded.recording import Answers, Recording
    from bench.diagnosis.views.base import Kind

__all__ = ["ExtraEvents", "OtherPolarity", "Response"]


class Response(View):
    """Share of test pulses that are answered."""

    id: ClassVar[str] = "response"
    title: ClassVar[str] = "response probability"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield the share of each group of pulses."""
        for answers in recording.groups:
            yield _of(answers.answered.sum(axis=1), answers, "share")


class ExtraEvents(View):
    """Events beyond the first that answer a pulse: large steps give several, a long dead time fewer."""

    id: ClassVar[str] = "extra_events"
    title: ClassVar[str] = "further events per pulse"
    unit: ClassVar[str] = "events/pulse"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield their number per pulse."""
        for answers in recording.groups:
            yield _of(np.maximum(answers.own - 1, 0).sum(axis=1), answers, "count")


class OtherPolarity(View):
    """Events of the polarity that the pulse does not ask for, in its window: noise, rebounds, filters."""

    id: ClassVar[str] = "other_polarity"
    title: ClassVar[str] = "events of the other polarity per pulse"
    unit: ClassVar[str] = "events/pulse"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield their number per pulse."""
        for answers in recording.groups:
            yield _of(answers.other.sum(axis=1), answers, "count")


def _of(top: npt.NDArray[np.integer], answers: Answers, kind: Kind) -> Statistic:
    return Statistic(
        part=answers.test.polarity,
        kind=kind,
        top=top.astype(np.float64),
        bottom=np.full(top.size, float(answers.test.pulses)),
        log_contrast=answers.test.log_contrast,
        width_s=answers.test.width_s,
    )
