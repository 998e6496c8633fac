"""A simulated bench whose instruments are reached through emulated wires, by the real drivers."""

from __future__ import annotations

import re
import secrets
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from protocols.errors import InputError
from sim_backend.wire.faults import Fault, FaultPlan, Faults
from sim_backend.wire.scpi import ReservedPort
from sim_backend.world import OpticalBench

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from sim_backend.wire.evk4_usb import Evk4Usb
    from sim_backend.wire.scpi import ScpiWire
    from sim_backend.wire.serial_wire import SerialWire
    from sim_backend.wire.wire import Firmware

__all__ = ["WiredBench"]

_SERIAL: Final = ("rs7", "led_driver", "wheel")
_INSTRUMENTS: Final = (*_SERIAL, "generator", "camera", "operator")
#: What an operator is asked.
_ASKED: Final = re.compile(r".*: put filter (?P<name>.+) \(OD .+\) into the light path")


class WiredBench(OpticalBench):
    """An optical bench with emulated instruments; each is switched on when something asks where it is.

    Parameters
    ----------
    filters
        Nominal optical density of each filter, by name, in the order of the positions of the filter wheel.
    bias_behaviour
        What the biases of the emulated camera do.
    faults
        What goes wrong: for an instrument (rs7, led_driver, wheel, generator, camera, or the operator) a list of
        mappings with `fault`, `at` and, if they are others, `times` and `seconds`; see
        :class:`~sim_backend.wire.faults.FaultPlan`.
    instruments
        For an instrument, arguments of its firmware; the generator's say its `dialect`.
    more
        See :class:`~sim_backend.world.OpticalBench`.

    Raises
    ------
    InputError
        An argument is out of range.
    """

    def __init__(
        self,
        *,
        filters: Mapping[str, float],
        bias_behaviour: Any = None,
        faults: Mapping[str, Sequence[Mapping[str, Any]]] | None = None,
        instruments: Mapping[str, Mapping[str, Any]] | None = None,
        **more: Any,
    ) -> None:
        super().__init__(**more)
        self._filters = dict(filters)
        self._behaviour = bias_behaviour
        self._arguments = {name: dict(given) for name, given in (instruments or {}).items()}
        self.faults = {name: Faults() for name in _INSTRUMENTS}  #: of each instrument
        for name, plans in (faults or {}).items():
            _require_known(name)
            for plan in plans:
                self.faults[name].plan(_fault(name, plan))
        for name in self._arguments:
            _require_known(name)
        #: Of the serial ports: it is there while the instruments are switched on.
        self._folder = Path(tempfile.gettempdir()) / f"evs-bench-wire-{secrets.token_hex(8)}"
        self._wanted: list[str] = []
        self._wires: dict[str, Any] = {}
        self._usb: Evk4Usb | None = None
        self._port_of_generator: ReservedPort | None = None

    @property
    def rs7(self) -> str:
        """Serial port of a SpectralLED RS-7."""
        return self._port("rs7")

    @property
    def led_driver(self) -> str:
        """Serial port of a microcontroller that drives an LED."""
        return self._port("led_driver")

    @property
    def wheel(self) -> str:
        """Serial port of a Thorlabs filter wheel."""
        return self._port("wheel")

    @property
    def generator(self) -> str:
        """Address of a function generator. The port is kept for it until it is switched on."""
        if self._port_of_generator is None:
            self._port_of_generator = ReservedPort()
            self._wanted.append("generator")
        return self._port_of_generator.address

    def operator(self, request: str) -> None:
        """Do what a driver asks a person to do: put a filter in.

        Raises
        ------
        EOFError
            The terminal was closed before it was confirmed: the fault `reply_lost`.
        InputError
            Nobody knows what is asked.
        """
        asked = _ASKED.fullmatch(request)
        if asked is None or asked["name"] not in self._filters:
            raise InputError(f"wired bench: the operator does not understand {request!r}")
        due = self.faults["operator"].due()
        self.set_filter(asked["name"], self._filters[asked["name"]])
        if due is not None and due.fault is Fault.REPLY_LOST:
            raise EOFError

    @property
    def camera(self) -> Evk4Usb:
        """USB with an EVK4."""
        if self._usb is None:
            from sim_backend.wire.evk4_usb import Evk4Usb

            self._usb = Evk4Usb(
                self,
                bias_behaviour=self._behaviour,
                faults=self.faults["camera"],
                **self._arguments.get("camera", {}),
            )
        return self._usb

    def open(self) -> None:
        """Switch the instruments on that something asked for; harmless if they are."""
        if any(name in _SERIAL for name in self._wanted):
            self._folder.mkdir(mode=0o700, exist_ok=True)
        for name in self._wanted:
            if name not in self._wires:
                self._wires[name] = self._generator_wire() if name == "generator" else self._wire(name)

    def close(self) -> None:
        """Switch them off."""
        while self._wires:
            self._wires.popitem()[1].close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _port(self, name: str) -> str:
        if name not in self._wanted:
            self._wanted.append(name)
        return str(self._folder / name)

    def _wire(self, name: str) -> SerialWire:
        from sim_backend.wire.serial_wire import SerialWire

        wire = SerialWire(
            self._firmware()[name](**self._arguments.get(name, {})),
            name,
            faults=self.faults[name],
            folder=self._folder,
        )
        wire.clock = self.clock
        return wire

    def _generator_wire(self) -> ScpiWire:
        from sim_backend.wire.scpi import ScpiWire
        from sim_backend.wire.scpi_makers import emulated_generator

        given = dict(self._arguments.get("generator", {}))
        if self._port_of_generator is None or "dialect" not in given:
            raise InputError("wired bench: instruments.generator has no dialect; expected rigol, siglent or keysight")
        firmware = emulated_generator(self, given.pop("dialect"), **given)
        wire = ScpiWire(firmware, self.faults["generator"], port=self._port_of_generator.use())
        wire.clock = self.clock
        return wire

    def _firmware(self) -> Mapping[str, Callable[..., Firmware]]:
        from sim_backend.wire.led_driver import LedFirmware
        from sim_backend.wire.rs7 import Rs7Firmware
        from sim_backend.wire.thorlabs_fw import ThorlabsFwFirmware

        return {
            "rs7": lambda **given: Rs7Firmware(self, **given),
            "led_driver": lambda **given: LedFirmware(self, **given),
            "wheel": lambda **given: ThorlabsFwFirmware(self, filters=list(self._filters.items()), **given),
        }


def _require_known(name: str) -> None:
    if name not in _INSTRUMENTS:
        raise InputError(f"wired bench: there is no instrument {name!r}; it has {', '.join(_INSTRUMENTS)}")


def _fault(name: str, plan: Mapping[str, Any]) -> FaultPlan:
    try:
        return FaultPlan(**{**plan, "fault": Fault(plan["fault"])})
    except (KeyError, TypeError, ValueError):
        known = ", ".join(Fault)
        raise InputError(
            f"wired bench: {name} has the fault {dict(plan)!r}; expected fault ({known}), at, and if they are others "
            "times and seconds"
        ) from None
