"""How answers vary: between pixels, from pulse to pulse, over the recording, in all pixels at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from bench.diagnosis.views.base import Statistic, View

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from bench.diagnosis.recorded.recording import Answers, Recording

__all__ = ["CommonMode", "Halves", "PixelSpread", "Succession"]


class PixelSpread(View):
    """Spread between pixels beyond chance: covariance of a pixel's share of even pulses with that of odd ones.

    Counting noise is not in it, as the two halves share none.
    """

    id: ClassVar[str] = "pixel_spread"
    title: ClassVar[str] = "variance of the response between pixels, beyond chance"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield the covariance."""
        for answers in recording.groups:
            even, odd = (
                answers.answered[:, k::2].mean(axis=1) if answers.test.pulses > 1 else np.zeros(len(answers.own))
                for k in (0, 1)
            )
            least = 4.0 / (answers.test.pulses**2 * len(even))
            yield _difference(
                answers, recording.about_mean(even) * recording.about_mean(odd), np.ones(len(even)), least=least,
                of_pairs=True,
            )  # fmt: skip


class Succession(View):
    """Covariance of the answers of a pixel to one pulse and to the next: what lasts from pulse to pulse."""

    id: ClassVar[str] = "succession"
    title: ClassVar[str] = "covariance of successive answers"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield the covariance."""
        for answers in recording.groups:
            away = recording.about_mean(answers.answered)
            pairs = max(answers.test.pulses - 1, 1)
            least = 1.0 / (pairs * len(away))
            products = (away[:, 1:] * away[:, :-1]).sum(axis=1)
            yield _difference(answers, products, np.full(len(away), float(pairs)), least=least, of_pairs=True)


class Halves(View):
    """Response in the second half of a recording less that in the first: what drifts."""

    id: ClassVar[str] = "halves"
    title: ClassVar[str] = "response in the second half less the first"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield the difference."""
        for answers in recording.groups:
            half = max(answers.test.pulses // 2, 1)
            first, second = answers.answered[:, :half], answers.answered[:, -half:]
            yield _difference(
                answers,
                (second.sum(axis=1) - first.sum(axis=1)).astype(np.float64),
                np.full(len(first), float(half)),
                least=1.0 / (half * len(first)),
            )


class CommonMode(View):
    """What all pixels do together from pulse to pulse: covariance over pulses of two interleaved sets of pixels."""

    id: ClassVar[str] = "common_mode"
    title: ClassVar[str] = "variance over pulses, common to all pixels"

    def look(self, recording: Recording) -> Iterator[Statistic]:
        """Yield the covariance."""
        for answers in recording.groups:
            answered = recording.by_sensor(answers.answered)
            first = answered[:, 0::2].mean(axis=1)
            second = answered[:, 1::2].mean(axis=1) if answered.shape[1] > 1 else np.zeros_like(first)
            product = np.prod([half - half.mean(axis=1, keepdims=True) for half in (first, second)], axis=0).ravel()
            least = 4.0 / (len(answers.own) ** 2 * product.size)
            yield _difference(answers, product, np.ones(product.size), by_pulse=True, least=least)


def _difference(
    answers: Answers,
    top: npt.NDArray[np.float64],
    bottom: npt.NDArray[np.float64],
    *,
    by_pulse: bool = False,
    least: float,
    of_pairs: bool = False,
) -> Statistic:
    return Statistic(
        part=answers.test.polarity,
        kind="difference",
        top=top,
        bottom=bottom,
        log_contrast=answers.test.log_contrast,
        width_s=answers.test.width_s,
        by_pulse=by_pulse,
        least=least,
        of_pairs=of_pairs,
    )
