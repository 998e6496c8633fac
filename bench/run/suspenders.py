"""What keeps a run from measuring for a while: conditions that are looked at before a point.

Each is a little stricter about going on than about waiting, so that a value at its limit does not make a run stop and
go. A device that does not answer keeps the run waiting too, which ends when it answers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from bench.run.suspenders_ambient import AmbientLight
from bench.run.suspenders_bench import DiskRoom, SensorTemperature, SteadyLight, TransferErrors
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from bench.station import Station
    from protocols.suspend import Suspend

__all__ = ["Suspender", "problems_with", "suspenders_of"]


class Suspender(Protocol):
    """One condition."""

    name: str  #: the key in the section `suspend`

    def why(self) -> str | None:
        """Return why the run should wait, with value and limit, for the operator; None if it need not."""


def problems_with(suspend: Suspend, station: Station) -> tuple[str, ...]:
    """Return what of `suspend` the station cannot do, a line each; it need not be connected."""
    if suspend.light_settled is not None and not measures_its_light(station):
        return (
            f"suspend.light_settled: {station.light.name} knows what it was told and does not measure its light; "
            "expected a source that does, or the key left out",
        )
    return ()


def measures_its_light(station: Station) -> bool:
    """Return whether the level that the light source reads back is measured."""
    return bool(getattr(station.light, "level_is_measured", False))


def suspenders_of(
    suspend: Suspend, station: Station, folder: Path, dark_rate: Callable[[], tuple[int, float]] | None = None
) -> tuple[Suspender, ...]:
    """Return the conditions of a run, what costs least first.

    Parameters
    ----------
    suspend
        What the protocol says.
    station
        Connected when a condition is looked at.
    folder
        Of the run; it need not exist yet.
    dark_rate
        Takes a short recording with the light source dark, and returns its events and how much it saw: pixels times
        seconds. Needed for `ambient`; see :class:`~bench.run.suspenders_ambient.DarkRecording`.

    Raises
    ------
    InputError
        The station cannot do it: one line for each.
    """
    problems = list(problems_with(suspend, station))
    if suspend.ambient is not None and dark_rate is None:
        problems.append("suspend.ambient: recordings in the dark cannot be taken here; expected the key left out")
    if problems:
        raise InputError(*problems)
    return tuple(_asked_for(suspend, station, folder, dark_rate))


def _asked_for(
    suspend: Suspend, station: Station, folder: Path, dark_rate: Callable[[], tuple[int, float]] | None
) -> Iterator[Suspender]:
    if suspend.disk_free_mib is not None:
        yield DiskRoom(folder, suspend.disk_free_mib)
    if suspend.temperature_c is not None:
        yield SensorTemperature(station.camera, suspend.temperature_c.low, suspend.temperature_c.high)
    if suspend.usb_errors is not None:
        yield TransferErrors(station.camera, station.clock, suspend.usb_errors.at_most, suspend.usb_errors.per_s)
    if suspend.light_settled is not None:
        settled = suspend.light_settled
        yield SteadyLight(station.light, station.clock, settled.within, settled.within_s)
    if suspend.ambient is not None and dark_rate is not None:
        yield AmbientLight(suspend.ambient, station.clock, folder, dark_rate)
