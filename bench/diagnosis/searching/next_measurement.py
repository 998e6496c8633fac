"""What to measure next, where the data cannot tell effects apart, or hardly can.

For some pairs it is known which protocol helps: by the physics. How far apart the two would be there is found by
simulating both; where that is not enough, or nothing is known, the other protocols are tried, the shortest first.
"""

from __future__ import annotations

from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench.diagnosis.searching.foreseen import apart_at, planned_points
from bench.diagnosis.searching.likeness import stand_in
from bench.diagnosis.searching.refit import Found
from protocols import load_protocol
from sim_backend.pixel.effects.registry import effects

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit
    from bench.diagnosis.searching.state import State
    from bench.store.data import PointData
    from sim_backend.pixel.model import PixelModel

__all__ = ["next_measurement", "protocol_for", "with_rivals"]

_LIGHT: Final = frozenset({"dark_current", "stray_light"})
_SLOW: Final = frozenset(
    {"photoreceptor_bandwidth", "source_follower_bandwidth", "light_rise_time", "comparator_delay"}
)
_DRIFTING: Final = frozenset({"leak", "parasitic_photocurrent", "light_drift", "hot_pixels", "low_frequency_noise"})
_NOISY: Final = frozenset({"shot_noise", "low_frequency_noise", "light_flicker", "reset_noise", "threshold_mismatch"})

#: Protocols that are tried where none is known to help, the shortest first.
_OTHERS: Final = ("quick_look", "background_activity", "pulse_width", "on_family", "off_family")
#: Standard errors that are enough to tell two effects apart, and below which a protocol is of no help.
_ENOUGH: Final = 5.0
_NO_HELP: Final = 2.0
#: An effect of which the screen expects so much of what another one takes away is nearly as good, if that is
#: more than so much: chance lets the best of all candidates fall as far.
_NEARLY: Final = 0.5
_SEEN: Final = 20.0
#: So many effects are told apart at the most, of which three may be tied.
_IN_A_GROUP: Final = 4
#: Sides of the window that is simulated. What a few pixels tell apart, mostly by far, more do too; a protocol takes
#: many times as long as a small run. So the larger one is only asked where this is less than so many times enough.
_SIDES: Final = (8, 16)
_SURELY: Final = 2.0

#: Effects of which two are told apart by a protocol of ours, and how; the first line that fits counts.
_APART: Final[tuple[tuple[frozenset[str], str, str], ...]] = (
    (_LIGHT, "pulse_width", "the dim S-curves again, in the end under a shroud without stray light (pulse_width)"),
    (_SLOW | {"dark_current"}, "pulse_width", "the response against pulse width (pulse_width)"),
    (_SLOW | _LIGHT, "pulse_width", "the response against pulse width, in the end under a shroud (pulse_width)"),
    (_DRIFTING, "background_activity", "background activity from darkness to bright light (background_activity)"),
    (_NOISY, "background_activity", "background activity from darkness to bright light (background_activity)"),
)

#: Wider pulses that are so many times as long show what pulse width does.
_WIDER: Final = 3.0


def _shows_widths(points: Sequence[PointData]) -> bool:
    widths = np.concatenate([p.pulse_stop_s - p.pulse_start_s for p in points])
    return widths.size > 0 and float(widths.max()) > _WIDER * float(widths.min())


#: Whether a run has what a protocol is for already.
_HAS: Final[dict[str, Callable[[Sequence[PointData]], bool]]] = {
    "pulse_width": _shows_widths,
    "background_activity": lambda points: any(p.waveform == "constant" for p in points),
}


def protocol_for(group: Sequence[str]) -> tuple[str, str] | None:
    """Return the protocol that is known to tell effects apart, and how it is said; None: none is known."""
    known = frozenset(group)
    return next(((protocol, title) for apart, protocol, title in _APART if known <= apart), None)


def with_rivals(
    points: Sequence[PointData], states: Sequence[State], missing: Sequence[str],
    ties: Mapping[str, Sequence[str]],
) -> dict[str, tuple[str, ...]]:  # fmt: skip
    """Return ties with those effects that were nearly as good, where a protocol shows what the runs do not.

    Runs may tell them apart by far, if the model is right in all details: a slow photoreceptor from a dark current
    at one pulse width by the latencies alone. Another protocol tells them apart by what they are.

    Parameters
    ----------
    points
        Of the runs.
    states
        Of the search, from the model that it started from.
    missing
        Effects that are named.
    ties
        Of some of them: those that could take their place.
    """
    found = {name: tuple(tied) for name, tied in ties.items()}
    for before, after in pairwise(states):
        drops = {one.effect.id: drop for one, drop in zip(before.scores.probes, before.scores.drop, strict=True)}
        name = after.added
        if name not in missing or name not in drops:
            continue
        near = [other for other, drop in drops.items() if drop > max(_NEARLY * drops[name], _SEEN)]
        for other in sorted(near, key=lambda other: -drops[other]):
            group = (name, *found.get(name, ()))
            if other in group or len(group) == _IN_A_GROUP or states[-1].fit.model.effect(other) is not None:
                continue
            known = protocol_for((*group, other))
            if known is not None and not _HAS[known[0]](points):
                found[name] = (*group[1:], other)
    return found


def next_measurement(
    problem: Problem, fit: Fit, ties: Mapping[str, Sequence[str]], seed: int
) -> dict[str, Any] | None:  # fmt: skip
    """Return the protocol that tells effects apart which a diagnosis cannot.

    Parameters
    ----------
    problem, fit
        The runs, and the model fitted to them.
    ties
        Of effects that it has: those that could take their place, or nearly could.
    seed
        Of the simulations.

    Returns
    -------
    dict or None
        Its name and minutes, how it is said, and by how many standard errors the nearest of the effects would be told
        from the one in the model, as far as simulations say. None where nothing is tied, or nothing helps.
    """
    for name, tied in ties.items():
        group = (name, *tied)
        rivals = [stand_in(problem, Found(name, fit, 0.0), effects()[other], seed) for other in tied]
        told = partial(_told, problem, fit, group, rivals, seed)
        known = protocol_for(group)
        best = None if known is None else told(known)
        if best is not None and best["separation"] >= _ENOUGH:
            return best
        for protocol in _OTHERS:
            if known is not None and protocol == known[0]:
                continue
            found = told((protocol, _title(protocol)))
            if best is None or found["separation"] > best["separation"]:
                best = found
            if best["separation"] >= _ENOUGH:
                return best
        if best is not None and best["separation"] >= _NO_HELP:
            return best
    return None


def _title(protocol: str) -> str:
    return f"{load_protocol(protocol).protocol.title} ({protocol})"


def _told(
    problem: Problem,
    fit: Fit,
    group: Sequence[str],
    rivals: Sequence[PixelModel],
    seed: int,
    protocol: tuple[str, str],
) -> dict[str, Any]:
    name, title = protocol
    return {
        "protocol": name,
        "title": title,
        "separates": list(group),
        "minutes": round(load_protocol(name).protocol.estimate().duration_s / 60.0, 1),
        "separation": round(_separation(problem, fit, rivals, name, seed), 1),
    }


def _separation(problem: Problem, fit: Fit, rivals: Sequence[PixelModel], protocol: str, seed: int) -> float:
    """Return by how many standard errors a protocol tells the first effect from the nearest of the others."""
    like = problem.points[0]
    planned = load_protocol(protocol).protocol.expand()
    found = 0.0
    for side in _SIDES:
        points = planned_points(planned, like, fit.model, side)
        of_all = len(planned) / len(points) * like.roi.pixels / points[0].roi.pixels
        found = min(apart_at(problem, fit, rival, points, of_all, seed + 1) for rival in rivals)
        if found >= _SURELY * _ENOUGH or points[0].roi == like.roi:
            break
    return found
