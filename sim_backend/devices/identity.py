"""How simulated devices introduce themselves."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

__all__ = ["simulated_identity"]


def simulated_identity(model: str, serial: str) -> dict[str, str]:
    """Return the identity of a simulated device: its firmware is this software."""
    try:
        firmware = version("evs-bench")
    except PackageNotFoundError:
        firmware = "0+unknown"
    return {"maker": "EVS bench", "model": model, "serial": serial, "firmware": firmware}
