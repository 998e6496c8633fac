"""Which answers belong to one S-curve: the same stimulus but for its contrast, the same settings, the same pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bench.analysis.results import CurveKey
from bench.analysis.scurve import CurveCounts

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bench.analysis.tally import GroupTally
    from bench.store.data import PointData
    from protocols.points import Roi, Waveform

__all__ = ["Entry", "curve_counts", "curve_keys", "settings_labels"]

# Levels and lengths that differ by less than this are the same one, measured: a clock of the host jitters.
_SAME_LEVEL: Final = 1e-3
_SAME_LENGTH: Final = 0.02


@dataclass(frozen=True, slots=True)
class Entry:
    """The answers to one group of test pulses, with what is needed to sort them into curves."""

    point: int
    waveform: Waveform
    baseline_lux: float
    nd_od: float
    bias: dict[str, float]
    roi: Roi
    active: npt.NDArray[np.bool_]  #: (pixels,)
    tally: GroupTally

    @classmethod
    def of(cls, point: PointData, active: npt.NDArray[np.bool_], tally: GroupTally) -> Entry:
        """Return the answers to one group of pulses of a point, of its pixels that are `active`."""
        return cls(
            point=point.index,
            waveform=point.waveform,
            baseline_lux=point.baseline_lux,
            nd_od=point.nd_od,
            bias=point.bias,
            roi=point.roi,
            active=active,
            tally=tally,
        )


def settings_labels(biases: Sequence[dict[str, float]]) -> list[str]:
    """Return for each of several bias settings the values of those biases that differ among them; else empty."""
    names = sorted({name for bias in biases for name in bias})
    varying = [n for n in names if len({bias.get(n) for bias in biases}) > 1]
    return [", ".join(f"{n}={bias[n]:g}" for n in varying if n in bias) for bias in biases]


def curve_keys(entries: Sequence[Entry], labels: Sequence[str]) -> list[CurveKey]:
    """Return the key of the S-curve to which each entry belongs.

    Where points that agree in everything else differ in their window of pixels, their response window or their
    reset, that is added to the label of the settings: one curve never mixes them.

    Parameters
    ----------
    entries
        All answers of a run.
    labels
        The label of the bias settings of each.
    """
    width = _same([e.tally.test.width_s for e in entries], _SAME_LENGTH)
    lux = _same([e.baseline_lux for e in entries], _SAME_LEVEL)
    window = _same([e.tally.test.window_s for e in entries], _SAME_LENGTH)
    reset = _same([e.tally.test.reset_log_contrast for e in entries], _SAME_LENGTH)
    keys = [
        CurveKey(
            waveform="square" if e.waveform == "square" else "reset_test",
            polarity=e.tally.test.polarity,
            baseline_lux=lux[i],
            nd_od=round(e.nd_od, 6),
            pulse_width_s=width[i],
            settings=labels[i],
        )
        for i, e in enumerate(entries)
    ]
    more = [_particulars(e, window[i], reset[i]) for i, e in enumerate(entries)]
    return [
        _told_apart(key, more[i], [more[j] for j, k in enumerate(keys) if k == key]) for i, key in enumerate(keys)
    ]


def _particulars(entry: Entry, window_s: float, reset: float) -> tuple[str, ...]:
    roi = entry.roi
    return (
        f"pixels {roi.width}x{roi.height} at {roi.x},{roi.y}",
        f"response window {window_s * 1e3:.3g} ms",
        f"reset {reset:+.3g} ln" if np.isfinite(reset) else "no reset",
    )


def _told_apart(key: CurveKey, mine: tuple[str, ...], all_of_key: Sequence[tuple[str, ...]]) -> CurveKey:
    varying = [text for i, text in enumerate(mine) if len({other[i] for other in all_of_key}) > 1]
    if not varying:
        return key
    label = ", ".join([key.settings, *varying] if key.settings else varying)
    return CurveKey(key.waveform, key.polarity, key.baseline_lux, key.nd_od, key.pulse_width_s, label)


def _same(values: Sequence[float], tolerance: float) -> list[float]:
    """Return the values with those that agree within a relative tolerance replaced by their median."""
    array = np.array(values, np.float64)
    result = array.copy()
    finite = np.flatnonzero(np.isfinite(array))
    order = finite[np.argsort(array[finite], kind="stable")]
    ordered = array[order]
    breaks = np.flatnonzero(np.diff(ordered) > tolerance * np.maximum(np.abs(ordered[1:]), np.abs(ordered[:-1])))
    for cluster in np.split(order, breaks + 1):
        if cluster.size:
            # A member of the cluster, not a mean of two: equal numbers stay what they are.
            result[cluster] = np.sort(array[cluster])[(cluster.size - 1) // 2]
    # Lengths in s and levels in lux carry the rounding of sums: 20.5 ms, not 20.499999999999963.
    return [float(np.round(v, 9)) for v in result]


def curve_counts(entries: Sequence[Entry]) -> CurveCounts:
    """Return the answers of one curve, ascending in contrast; points of the same contrast are added up."""
    contrast = np.array(_same([e.tally.test.log_contrast for e in entries], 1e-6))
    ascending = np.unique(contrast)
    pixels = entries[0].active.size
    answers = np.zeros((ascending.size, pixels), np.int64)
    trials = np.zeros((ascending.size, pixels), np.int64)
    for entry, row in zip(entries, np.searchsorted(ascending, contrast), strict=True):
        answers[row] += entry.tally.answers
        trials[row] += np.where(entry.active, entry.tally.test.pulses, 0)
    return CurveCounts(ascending, answers, trials)
