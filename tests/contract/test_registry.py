"""No driver and no simulated device escapes the contract tests."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from typing import TYPE_CHECKING, Any

import drivers
import sim_backend
from drivers.interfaces import Clock, Device, EventCamera, FilterWheel, LightSource

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

KINDS: tuple[type, ...] = (LightSource, FilterWheel, EventCamera)


def classes() -> Iterator[type[Any]]:
    """Yield all classes that are defined in the two packages."""
    for package in (drivers, sim_backend):
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if found.name.endswith("kernels"):
                continue  # compiled functions, no classes
            module = importlib.import_module(found.name)
            for _, cls in inspect.getmembers(module, inspect.isclass):
                if cls.__module__ == module.__name__:
                    yield cls


def test_every_concrete_device_and_clock_has_a_rig(rigs: dict[type, dict[str, Callable[[], Any]]]) -> None:
    concrete = {
        cls
        for cls in classes()
        if cls is not Clock and not inspect.isabstract(cls) and (issubclass(cls, Device) or issubclass(cls, Clock))
    }
    assert concrete == set(rigs)


def test_every_device_is_of_a_known_kind() -> None:
    odd = [c for c in classes() if issubclass(c, Device) and c not in (Device, *KINDS) and not issubclass(c, KINDS)]
    assert not odd
