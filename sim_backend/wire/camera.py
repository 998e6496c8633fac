"""The driver of the EVK4 on an emulated camera that is told the seed of each recording."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivers.camera.evk4.evk4 import Evk4

if TYPE_CHECKING:
    from pathlib import Path

    from drivers.interfaces import Clock, Recording
    from sim_backend.wire.evk4_usb import Evk4Usb

__all__ = ["WiredEvk4"]


class WiredEvk4(Evk4):
    """An EVK4 whose recordings can be taken again: the emulated camera hears of the seed and the surroundings.

    Parameters
    ----------
    clock
        Of the emulated camera's world.
    backend
        The emulated camera.
    serial, transfer_bytes, transfers, raw_folder, trigger_inverted, name
        See :class:`drivers.camera.evk4.evk4.Evk4`.
    """

    def __init__(
        self,
        *,
        clock: Clock,
        backend: Evk4Usb,
        serial: str | None = None,
        transfer_bytes: int = 131072,
        transfers: int = 256,
        raw_folder: Path | str | None = None,
        trigger_inverted: bool = False,
        name: str = "camera",
    ) -> None:
        super().__init__(
            serial=serial,
            clock=clock,
            backend=backend,
            transfer_bytes=transfer_bytes,
            transfers=transfers,
            raw_folder=raw_folder,
            trigger_inverted=trigger_inverted,
            name=name,
        )
        self._emulated = backend

    def start(self, recording: Recording) -> None:
        """Start a recording; time is 0 now."""
        self._emulated.expect(recording)
        super().start(recording)
