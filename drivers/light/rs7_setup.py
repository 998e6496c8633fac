"""How an RS-7 is set up when a station connects to it: units, working distance, feedback, attenuator, spectrum."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, Protocol

from drivers.errors import UnexpectedAnswer, WrongState
from protocols.errors import InputError

__all__ = ["Setup", "Unit"]

#: For each unit of the level: number of `UNI`, and whether it is meant at a distance (irradiance, illuminance).
_UNITS: Final[dict[str, tuple[int, bool | None]]] = {
    "cd/m2": (1, False),
    "lux": (1, True),
    "uW/cm2/sr": (0, False),
    "uW/cm2": (0, True),
    "%": (2, None),
}
_NONE: Final = ("", "0", "NONE")


class Unit(Protocol):
    """What the set-up needs of a driver."""

    name: str

    def do(self, command: str) -> None:
        """Have a command carried out that is answered with Ok."""

    def value(self, command: str) -> str:
        """Return what a command is answered with, one line."""

    def rows(self, command: str) -> tuple[str, ...]:
        """Return what a command is answered with, several lines."""


@dataclass(frozen=True, slots=True)
class Setup:
    """What a station wants of its RS-7."""

    unit: str
    spectrum: str | int | None
    working_distance_mm: float | None
    settle_percent: float | None
    feedback: bool
    attenuator: Literal["refuse", "recorded"]

    def __post_init__(self) -> None:
        if self.unit not in _UNITS:
            raise InputError(f"RS-7: unit is {self.unit!r}; expected {', '.join(_UNITS)}")
        if self.attenuator not in ("refuse", "recorded"):
            raise InputError(f"RS-7: attenuator is {self.attenuator!r}; expected refuse or recorded")
        distance_mm = self.working_distance_mm
        if distance_mm is not None and not 0.0 < distance_mm < 1e5:
            raise InputError(f"RS-7: working_distance_mm is {distance_mm}; expected more than 0 mm")
        if distance_mm is not None and self._at_a_distance is False:
            raise InputError(f"RS-7: working_distance_mm with {self.unit}, which does not depend on it; leave it out")
        if self.settle_percent is not None and not 0.0 < self.settle_percent <= 100.0:
            raise InputError(f"RS-7: settle_percent is {self.settle_percent}; expected more than 0, at most 100")
        if isinstance(self.spectrum, int) and self.spectrum < 0:
            raise InputError(f"RS-7: spectrum is {self.spectrum}; expected the number or the name of a preset")

    @property
    def _at_a_distance(self) -> bool | None:
        return _UNITS[self.unit][1]

    @property
    def spectral_unit(self) -> str:
        """Unit of the spectrum that the unit reports."""
        return "uW/cm2/nm" if self._at_a_distance or self.working_distance_mm is not None else "uW/cm2/nm/sr"

    def identify(self, unit: Unit) -> dict[str, str]:
        """Return who the unit is and how it is calibrated."""
        return {
            "maker": "Gamma Scientific",
            "model": "SpectralLED RS-7",
            "serial": unit.value("USN"),
            "firmware": unit.value("VER"),
            "calibration": unit.value("CAL"),
            "calibration data": unit.value("SDC"),
            "attenuator": self._attenuator_of(unit),
        }

    def apply(self, unit: Unit) -> None:
        """Set the unit up, and read back what decides on the meaning of a level.

        Raises
        ------
        DeviceError
            It cannot be set up so, or says otherwise when it is read back.
        """
        number, at_a_distance = _UNITS[self.unit]
        _set(unit, "UNI", str(number))
        if at_a_distance is not None:
            self._set_distance(unit)
        _set(unit, "FBK", str(int(self.feedback)))
        if self.settle_percent is not None:
            _set(unit, "STP", f"{self.settle_percent:g}")
        if self.spectrum is not None:
            unit.do(f"PRE {self._preset(unit)}")
            unit.do("OUT 0")

    def _set_distance(self, unit: Unit) -> None:
        kind = unit.value("CTY").upper()
        fixed = kind.startswith("I")  # calibrated for irradiance: it has no other
        if fixed and not self._at_a_distance:
            raise WrongState(unit.name, f"use {self.unit}", "it is calibrated for irradiance", "use lux or uW/cm2")
        if fixed and self.working_distance_mm is None:
            return
        if self._at_a_distance and self.working_distance_mm is None:
            raise WrongState(
                unit.name, f"use {self.unit}", "no working distance is known", "give working_distance_mm"
            )
        _set(unit, "IRR", f"{self.working_distance_mm or 0.0:g}")

    def _attenuator_of(self, unit: Unit) -> str:
        active = unit.value("ATF").strip()
        if active.upper() in _NONE:
            return "none"
        if self.attenuator == "refuse":
            raise WrongState(
                unit.name,
                "have no attenuating filter declared (ATF)",
                f"{active} is active, and the levels include it",
                "switch it off (ATF 0), or say attenuator: recorded",
            )
        return active

    def _preset(self, unit: Unit) -> str:
        if isinstance(self.spectrum, int):
            return str(self.spectrum)
        wanted = str(self.spectrum).strip().lower()
        names: list[str] = []
        for row in unit.rows("PRE *"):
            number, _, name = row.partition(",")
            if name.strip().lower() == wanted and number.strip().isdecimal():
                return number.strip()
            names.append(name.strip())
        raise WrongState(
            unit.name, f"load the preset {self.spectrum!r}", "no such preset", f"it has {', '.join(names) or 'none'}"
        )


def _set(unit: Unit, acronym: str, value: str) -> None:
    """Set a number, and see that it is set."""
    unit.do(f"{acronym} {value}")
    said = unit.value(acronym)
    try:
        same = abs(float(said) - float(value)) <= 1e-6 * abs(float(value))
    except ValueError:
        same = False
    if not same:
        raise UnexpectedAnswer(
            unit.name, f"{acronym} {value}", f"it reads back as {said}", "does its firmware know it?"
        )
