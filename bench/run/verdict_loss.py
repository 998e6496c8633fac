"""What is missing from a recording: stretches of the stream, words that made no sense, pulses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from bench.run.verdict_case import amber, red, share_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from bench.run.verdict_case import Case, Found

__all__ = ["gaps", "invalid_pulses", "lost_on_the_way", "undecoded"]

#: Counters of the quality, and how they are called.
_LOST: Final = {"dropped_buffers": "transfers dropped", "overflows": "overflows of the camera"}


def gaps(case: Case) -> Iterator[Found]:
    """Yield that stretches of the stream are missing."""
    if not case.record.gaps_s:
        return
    lost_s = float(_merged(case.record.gaps_s).sum())
    share, touched = lost_s / case.record.duration_s, _windows_touched(case)
    number = len(case.record.gaps_s)
    text = (
        f"events are missing: {number} gap{'s' if number > 1 else ''}, {lost_s:.3g} s in all, {share_text(share)} of "
    )
    text += "the recording"
    if case.pulses:
        text += f", in {touched} of {case.pulses} response windows"
    limits = case.limits
    again = share > limits.lost_again or (case.pulses and touched > limits.windows_lost_again * case.pulses)
    yield red(text) if again else amber(text)


def _merged(gaps_s: tuple[tuple[float, float], ...]) -> npt.NDArray[np.float64]:
    """Return the lengths of the gaps (s), what two of them share counted once."""
    begin, end = np.array(sorted(gaps_s), np.float64).T
    reached = np.concatenate([[-np.inf], np.maximum.accumulate(end)[:-1]])
    return np.asarray(np.maximum(end - np.maximum(begin, reached), 0.0))


def _windows_touched(case: Case) -> int:
    start, stop = case.record.pulses.start_s, case.record.pulses.stop_s
    touched = np.zeros(case.pulses, bool)
    for begin_s, end_s in case.record.gaps_s:
        touched |= (start < end_s) & (stop > begin_s)
    return int(touched.sum())


def lost_on_the_way(case: Case) -> Iterator[Found]:
    """Yield that the camera or the computer lost something and nobody knows where."""
    if case.record.gaps_s:
        return
    counts = {words: case.record.quality.get(key, 0) for key, words in _LOST.items()}
    text = ", ".join(f"{count} {words}" for words, count in counts.items() if count)
    if text:
        yield red(f"events were lost, and it is not known when: {text}")


def undecoded(case: Case) -> Iterator[Found]:
    """Yield that part of the stream broke the rules of its format."""
    errors = int(case.record.quality.get("decode_errors", 0))
    if not errors:
        return
    share = errors / max(case.seen.n_events + errors, 1)
    text = f"{errors} decode errors beside {case.seen.n_events} events ({share_text(share)})"
    yield red(text) if share > case.limits.decode_errors_again else amber(text)


def invalid_pulses(case: Case) -> Iterator[Found]:
    """Yield that pulses are marked as not valid."""
    valid = case.record.pulses.valid
    if valid is None or not len(valid):
        return
    invalid = int((valid == 0).sum())
    share = invalid / len(valid)
    if share > case.limits.invalid_pulses:
        text = f"{invalid} of {len(valid)} pulses are not valid"
        yield red(text) if share > case.limits.invalid_pulses_again else amber(text)
