"""What all devices have in common."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import pytest

from drivers.errors import DeviceError, WrongState
from drivers.interfaces import Device

if TYPE_CHECKING:
    from collections.abc import Callable


def devices(rigs: dict[type, dict[str, Callable[[], Any]]]) -> list[Device]:
    """Return a fresh device of each rig."""
    built = []
    for cls, variants in rigs.items():
        if issubclass(cls, Device):
            for build in variants.values():
                built += [part for part in vars(build()).values() if isinstance(part, Device)]
    return built


def test_constructor_does_not_connect(rigs: dict[type, dict[str, Callable[[], Any]]]) -> None:
    assert not any(device.connected for device in devices(rigs))


def test_identity_is_text(rigs: dict[type, dict[str, Callable[[], Any]]]) -> None:
    for device in devices(rigs):
        device.connect()
        identity = device.identity()
        assert {"maker", "model", "serial", "firmware"} <= set(identity), device.name
        assert all(isinstance(text, str) and text for text in identity.values()), device.name
        device.close()


def test_identity_needs_a_connection(rigs: dict[type, dict[str, Callable[[], Any]]]) -> None:
    for device in devices(rigs):
        with pytest.raises(WrongState, match=f"^{device.name}: .*not connected"):
            device.identity()


def test_safe_state_is_harmless_at_any_time(rigs: dict[type, dict[str, Callable[[], Any]]]) -> None:
    for device in devices(rigs):
        device.safe_state()
        device.connect()
        device.safe_state()
        device.safe_state()
        device.close()
        device.safe_state()


def failure(device: Device) -> DeviceError | None:
    """Return what the last safe state of `device` could not do."""
    return device.unsafe


def test_a_safe_state_that_fails_is_told_and_a_later_one_takes_it_back(
    rigs: dict[type, dict[str, Callable[[], Any]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail() -> None:
        raise OSError(5, "Input/output error")

    for device in devices(rigs):
        device.connect()
        with monkeypatch.context() as broken:
            broken.setattr(device, "_safe_state", fail)
            device.safe_state()
            what = "could not be (made dark|brought to its safe state)"
            assert re.match(rf"{device.name}: {what}: .*Input/output error; .* by hand", str(failure(device)))
            device.close()
            assert failure(device) is not None
            with pytest.raises(DeviceError, match=what):
                device.connect()
            assert not device.connected
        device.connect()
        assert failure(device) is None
        device.close()


def test_close_is_harmless_at_any_time_and_can_be_undone(rigs: dict[type, dict[str, Callable[[], Any]]]) -> None:
    for device in devices(rigs):
        device.close()
        device.connect()
        device.close()
        device.close()
        with pytest.raises(DeviceError):
            device.identity()
        device.connect()
        device.identity()
        device.close()
