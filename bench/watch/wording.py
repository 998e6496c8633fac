"""What the page says of points and of the run, in words."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from bench.analysis.results import BackgroundRow
    from bench.watch.counting import PointCounts, Response
    from bench.watch.history import PointState, Remark
    from bench.watch.planned import PlannedLook

__all__ = ["BADGES", "WORDS", "look_text", "point_lines", "remark_text", "row_text"]

WORDS: Final[dict[PointState, str]] = {
    "planned": "planned",
    "measuring": "being measured",
    "done": "done",
    "doubtful": "done, doubtful",
    "bad": "judged bad",
    "failed": "failed",
    "skipped": "skipped",
}
BADGES: Final = {
    "measuring": "Measuring",
    "paused": "Paused",
    "suspended": "Suspended",
    "finished": "Finished",
    "aborted": "Stopped",
    "failed": "Failed",
    "dead": "Nothing is writing this run",
}


def look_text(look: PlannedLook) -> str:
    """Return what a point of the plan is: ``on, 3 lux, log contrast 0.310``."""
    polarity = "" if look.waveform == "constant" or look.measurement.lower() == look.polarity else look.polarity
    parts = [look.measurement, row_text(look.baseline_lux, polarity)]
    return ", ".join([*parts, f"log contrast {look.log_contrast:.3f}"] if look.log_contrast > 0.0 else parts)


def row_text(lux: float, polarity: str) -> str:
    """Return a light level, and a polarity where one is given: ``3 lux, ON``."""
    from bench.report.wording import lux_label, polarity_label

    shown = "ON and OFF" if polarity == "both" else polarity_label(polarity)
    return f"{lux_label(lux)}, {shown}" if polarity else lux_label(lux)


def point_lines(counts: PointCounts) -> list[str]:
    """Return what was measured in a point, a line for each number."""
    return [*map(_response_text, counts.responses), *map(_rate_text, counts.background)]


def _response_text(response: Response) -> str:
    share = f"{response.probability:.3f} ({response.low:.3f} to {response.high:.3f})"
    return f"{response.polarity.upper()} response {share}"


def _rate_text(row: BackgroundRow) -> str:
    rate = row.rate
    shown = f"{rate.value:.3g} Hz ({rate.low:.2g} to {rate.high:.2g})" if row.events else f"below {rate.high:.2g} Hz"
    return f"{row.polarity.upper()} background {shown}"


def remark_text(remark: Remark) -> str:
    """Return what a line of the journal says of a point: ``attempt 2, failed: the camera is gone``."""
    attempt = f"attempt {remark.attempt}, " if remark.attempt > 1 else ""
    return f"{attempt}{WORDS[remark.state]}{f': {remark.text}' if remark.text else ''}"
