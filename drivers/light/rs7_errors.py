"""What an RS-7 complains of, and what a driver makes of it: try again, take it as refused, or stop the run.

Source: Gamma Scientific, SpectralLED RS-7 User Manual, rev. A/X1 (2018), chapter 4. The wording here is our own.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from drivers.errors import DeviceError, WrongState

__all__ = ["CODES", "Complaint", "Treatment", "complaint_in", "complaint_raised"]

_LINE: Final = re.compile(r"\?([AF]?\d{1,2})(?:\s*-\s*|\s+|$)(.*)")


class Treatment(StrEnum):
    """What to do about a complaint."""

    RETRY = "retry"  #: it may go away by itself
    REFUSE = "refuse"  #: what was asked cannot be done; nothing was changed
    STOP = "stop"  #: the light, or the unit, is not what it should be
    NOTE = "note"  #: an alarm to be written down
    FAIL = "fail"  #: driver and unit do not understand each other


@dataclass(frozen=True, slots=True)
class Complaint:
    """An error or an alarm of the unit."""

    code: str  #: "18", "A3", "F1"
    text: str  #: in the words of the unit, or ours if it gave none

    @property
    def is_alarm(self) -> bool:
        """Whether the unit may send it without having been asked."""
        return self.code.startswith("A")

    @property
    def treatment(self) -> Treatment:
        """What to do about it."""
        return CODES[self.code][0] if self.code in CODES else Treatment.FAIL

    def __str__(self) -> str:
        return f"?{self.code} - {self.text}"


#: Treatment and meaning of each code.
CODES: Final[dict[str, tuple[Treatment, str]]] = {
    "01": (Treatment.FAIL, "an argument is missing"),
    "02": (Treatment.REFUSE, "an argument is out of range"),
    "03": (Treatment.FAIL, "unknown command"),
    "04": (Treatment.FAIL, "input buffer overflow"),
    "05": (Treatment.FAIL, "the fit of the spectrum failed"),
    "06": (Treatment.REFUSE, "the power cannot be reached"),
    "07": (Treatment.REFUSE, "the power cannot be reached"),
    "08": (Treatment.REFUSE, "the power cannot be reached"),
    "09": (Treatment.REFUSE, "the power cannot be reached"),
    "10": (Treatment.REFUSE, "beyond the soft power limit"),
    "11": (Treatment.FAIL, "the feedback is out of range"),
    "12": (Treatment.FAIL, "too little spectral data"),
    "13": (Treatment.FAIL, "the chromaticity does not converge"),
    "14": (Treatment.FAIL, "wrong units for this command"),
    "15": (Treatment.FAIL, "the target spectrum is zero"),
    "16": (Treatment.REFUSE, "the output spectrum is zero at all wavelengths"),
    "17": (Treatment.REFUSE, "no such preset"),
    "18": (Treatment.RETRY, "the output did not settle within 0.5 s"),
    "19": (Treatment.FAIL, "no calibration for these units"),
    "20": (Treatment.REFUSE, "the level is too low for the optical feedback"),
    "21": (Treatment.FAIL, "the channel is empty"),
    "22": (Treatment.STOP, "EEPROM failure"),
    "23": (Treatment.STOP, "no power table"),
    "24": (Treatment.REFUSE, "the level is beyond the range of the optical feedback"),
    "25": (Treatment.FAIL, "wrong passcode"),
    "26": (Treatment.FAIL, "wavelength monitor"),
    "27": (Treatment.FAIL, "wavelength monitor"),
    "28": (Treatment.FAIL, "wavelength monitor"),
    "A1": (Treatment.NOTE, "power limit reached"),
    "A2": (Treatment.NOTE, "alarm without a meaning in this firmware"),
    "A3": (Treatment.STOP, "the output is less than half or more than twice what it should be"),
    "A4": (Treatment.RETRY, "the optical feedback lost its lock"),
    "A5": (Treatment.NOTE, "the LEDs are more than 1 degree from their temperature"),
    "A6": (Treatment.STOP, "above 40 degrees Celsius: the LEDs are off"),
    "A7": (Treatment.STOP, "below 19.5 degrees Celsius for 15 s"),
    "A8": (Treatment.NOTE, "the monitor is off its temperature"),
    "A9": (Treatment.NOTE, "the monitor is off its temperature"),
    "F1": (Treatment.STOP, "fault: the unit obeys nothing until it is cleared"),
}

_ADVICE: Final[dict[str, str]] = {
    "02": "choose a level within the range of the unit for this spectrum",
    "16": "load a preset: give the driver a spectrum",
    "17": "store the preset, or name another one",
    "18": "allow more time or a larger settle_percent",
    "20": "use a neutral density filter and a higher level, or no feedback",
    "24": "choose a lower level, or no feedback",
    "A4": "see what disturbs the light: a lower level, or a longer warm-up",
    "A6": "stop the run, and let it cool",
    "A7": "stop the run, and let it warm up",
    "F1": "stop the run, switch the unit off and on, and have it looked at (command CFC clears the fault)",
}
_ADVICE_BY_TREATMENT: Final[dict[Treatment, str]] = {
    Treatment.RETRY: "try again",
    Treatment.REFUSE: "choose a level that the unit can reach with this spectrum",
    Treatment.STOP: "stop the run: the light is not what it should be",
    Treatment.NOTE: "see the manual of the unit",
    Treatment.FAIL: "is this an RS-7, and does its firmware know this command?",
}


def complaint_in(line: str) -> Complaint | None:
    """Return what a line complains of; None for any other line."""
    found = _LINE.fullmatch(line.strip())
    if found is None:
        return None
    code = found[1] if found[1][0] in "AF" else found[1].zfill(2)
    known = CODES.get(code, (Treatment.FAIL, "an error that the manual does not list"))
    return Complaint(code, found[2].strip() or known[1])


def complaint_raised(device: str, asked: str, complaint: Complaint) -> DeviceError:
    """Return the error that says what the unit complained of when it was asked `asked`."""
    treatment = complaint.treatment
    advice = _ADVICE.get(complaint.code, _ADVICE_BY_TREATMENT[treatment])
    kind = WrongState if treatment is Treatment.REFUSE else DeviceError
    return kind(device, asked, str(complaint), advice)
