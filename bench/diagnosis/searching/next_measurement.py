"""What to measure next, where the data cannot tell effects apart.

For some pairs it is known which protocol helps: by the physics. How far apart the two would be there is found by
simulating both; where that is not enough, or nothing is known, the other protocols are tried, the shortest first.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, Final

from bench.diagnosis.expected.catalogue import are_the_same
from bench.diagnosis.searching.foreseen import apart_at, planned_points
from bench.diagnosis.searching.likeness import stand_in
from bench.diagnosis.searching.refit import Found
from protocols import load_protocol
from sim_backend.pixel.effects.registry import effects

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from bench.diagnosis.expected.problem import Problem
    from bench.diagnosis.fitting.fitted import Fit
    from protocols.points import Ambient
    from sim_backend.pixel.model import PixelModel

__all__ = ["next_measurement", "protocol_for"]

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
#: Sides of the window that is simulated. What a few pixels tell apart, mostly by far, more do too; a protocol takes
#: many times as long as a small run. So the larger one is only asked where this is less than so many times enough.
_SIDES: Final = (8, 16)
_SURELY: Final = 2.0

#: Effects of which two are told apart by a protocol of ours, and how; the first line that fits counts.
_APART: Final[tuple[tuple[frozenset[str], str, str], ...]] = (
    (_LIGHT, "on_family", "the dim S-curves again under a shroud, where there is no stray light (on_family)"),
    (_LIGHT | _SLOW, "pulse_width", "the response against pulse width (pulse_width)"),
    (_DRIFTING, "background_activity", "background activity from darkness to bright light (background_activity)"),
    (_NOISY, "background_activity", "background activity from darkness to bright light (background_activity)"),
)


def protocol_for(group: Sequence[str]) -> tuple[str, str] | None:
    """Return the protocol that is known to tell effects apart, and how it is said; None: none is known."""
    known = frozenset(group)
    return next(((protocol, title) for apart, protocol, title in _APART if known <= apart), None)


def next_measurement(
    problem: Problem, fit: Fit, ties: Mapping[str, Sequence[str]], seed: int
) -> dict[str, Any] | None:  # fmt: skip
    """Return the protocol that tells effects apart which a diagnosis cannot.

    Parameters
    ----------
    problem, fit
        The runs, and the model fitted to them.
    ties
        Of effects that it has: those that could take their place.
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
        "separation": round(_separation(problem, fit, group, rivals, name, seed), 1),
    }


def _separation(
    problem: Problem, fit: Fit, group: Sequence[str], rivals: Sequence[PixelModel], protocol: str, seed: int
) -> float:
    """Return by how many standard errors a protocol tells the first effect from the nearest of the others."""
    like = problem.points[0]
    planned = load_protocol(protocol).protocol.expand()
    # What is the same to a pixel is not so behind a shroud.
    covered: Ambient | None = (
        "shrouded" if any(are_the_same(group[0], other, problem.points) for other in group[1:]) else None
    )
    found = 0.0
    for side in _SIDES:
        points = planned_points(planned, like, fit.model, covered, side)
        of_all = len(planned) / len(points) * like.roi.pixels / points[0].roi.pixels
        found = min(apart_at(problem, fit, rival, points, of_all, seed + 1) for rival in rivals)
        if found >= _SURELY * _ENOUGH or points[0].roi == like.roi:
            break
    return found
