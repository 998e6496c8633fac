"""How the makers of function generators spell the same things.

All are told to wait, armed, for the trigger of a burst of square cycles: the light is then at the lower level of the
square wave, and stays there while its upper level, frequency, duty and number of cycles are set. Switching between
direct voltage and a burst would make steps at the output that belong to no waveform.

What the output does between bursts is said differently by each maker:

- Rigol has a command for it (`BURSt:IDLE BOTTOM`; the default is the first point, which is the upper level).
- Keysight holds the level of the phase at which the burst starts. A square wave starts with its upper level at
  0 degrees, so the burst starts shortly before 360 degrees, in the lower part: the first rise then comes `lead_s`
  after the trigger, and the burst ends `lead_s` before the end of the last period.
- Siglent has no command either, and its programming guide does not say what the output does. Units of this family
  were seen to hold the level of the start phase, so it is told the same as Keysight; look at it with an oscilloscope
  before relying on it. It has no answer that comes at the end of a burst.

Samples of other waveforms are the matter of :mod:`drivers.light.scpi_uploads`.

Sources: Rigol DG800 and DG1000Z programming guides, chapter 2; Agilent 33220A user's guide, chapter 4 (burst mode
commands), and the BURSt subsystem in the help of the Keysight 33500 series; Siglent SDG programming guide PG02,
sections 3.3 (OUTP), 3.4 (BSWV), 3.7 (BTWV) and SYNC.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Final, Literal

__all__ = ["DIALECTS", "Dialect", "Keysight", "Load", "Rigol", "Setting", "Siglent"]

Load = Literal["high_z", 50]

#: A load that is read back as more than this is an open one: SCPI says 9.9E37 for infinity.
_INFINITE_OHM: Final = 1e30

_BOTH: Final = {True: ("ON", "1"), False: ("OFF", "0")}


@dataclass(frozen=True, slots=True)
class Setting:
    """A command, and how to ask for what came of it."""

    what: str  #: for messages
    command: str
    question: str
    expected: float | tuple[str, ...]  #: a number, or the words that mean the same
    unit: str = ""  #: of the number
    tolerance: float = 0.0  #: by how much the number may be rounded
    field: str = ""  #: which of the fields of an answer that has several
    optional: bool = False  #: left alone where the instrument does not know it


class Dialect(ABC):
    """The commands of one maker, for one channel."""

    makers: ClassVar[tuple[str, ...]]  #: how the maker may call itself, in lower case
    most_cycles: ClassVar[int]
    duty: ClassVar[tuple[float, float]]  #: lowest and highest high part of a period
    highest_hz: ClassVar[float]
    starts_low: ClassVar[bool]  #: whether the burst has to start in the lower part of the square wave
    tells_end: ClassVar[bool]  #: whether *OPC? is answered when a burst is over

    def __init__(self, channel: int) -> None:
        self.channel = channel

    @abstractmethod
    def preparation(self) -> tuple[Setting, ...]:
        """Return what makes a burst of square cycles wait for its trigger, apart from :meth:`square`."""

    @abstractmethod
    def square(self, frequency_hz: float, duty: float, cycles: int, phase_deg: float) -> tuple[Setting, ...]:
        """Return what sets the time course of the burst; the second one is the duty."""

    @abstractmethod
    def low(self, volts: float) -> Setting:
        """Return what sets the lower level."""

    @abstractmethod
    def high(self, volts: float) -> Setting:
        """Return what sets the upper level."""

    @abstractmethod
    def output(self, on: bool) -> Setting:
        """Return what switches the output."""

    @abstractmethod
    def load(self, load: Load) -> Setting:
        """Return what tells the generator into which load it works, ohm."""

    @property
    @abstractmethod
    def trigger(self) -> str:
        """Command that starts the burst."""

    def value(self, setting: Setting, answer: str) -> str | None:
        """Return the value in `answer`; None if it is not there."""
        return answer if not setting.field else None


def _text(number: float) -> str:
    """Return a number as all dialects read it: all its digits, and no ``.0``, which some misread."""
    return format(number, ".15g")


def _volts(what: str, command: str, question: str, volts: float, field: str = "") -> Setting:
    return Setting(what, command, question, volts, "V", max(1e-3 * abs(volts), 1e-3), field)


def _words(what: str, head: str, word: str, *same: str) -> Setting:
    return Setting(what, f"{head} {word}", f"{head}?", (word, *same))


class _Tree(Dialect):
    """Commands in a tree, as SCPI has them: Rigol and Keysight."""

    source: str  #: head of what belongs to the source
    out: str  #: head of what belongs to the output

    def square(self, frequency_hz: float, duty: float, cycles: int, phase_deg: float) -> tuple[Setting, ...]:
        """Return what sets the time course of the burst; the second one is the duty."""
        return (
            self._number("frequency", "FREQ", frequency_hz, "Hz", 1e-6 * frequency_hz),
            self._number("duty", "FUNC:SQU:DCYC", 100.0 * duty, "%", 0.02),
            self._number("number of cycles", "BURS:NCYC", float(cycles), "", 0.0),
            self._number("start phase", "BURS:PHAS", phase_deg, "degrees", 0.1),
        )

    def low(self, volts: float) -> Setting:
        """Return what sets the lower level."""
        return _volts("lower level", f"{self.source}VOLT:LOW {_text(volts)}", f"{self.source}VOLT:LOW?", volts)

    def high(self, volts: float) -> Setting:
        """Return what sets the upper level."""
        return _volts("upper level", f"{self.source}VOLT:HIGH {_text(volts)}", f"{self.source}VOLT:HIGH?", volts)

    def output(self, on: bool) -> Setting:
        """Return what switches the output."""
        return _words("output", self.out, *_BOTH[on])

    def load(self, load: Load) -> Setting:
        """Return what tells the generator into which load it works, ohm."""
        head = f"{self.out}:LOAD"
        if load == "high_z":
            return Setting("load", f"{head} INF", f"{head}?", ("INF", "INFINITY"))
        return Setting("load", f"{head} {load}", f"{head}?", float(load), "ohm", 0.5)

    def value(self, setting: Setting, answer: str) -> str | None:
        """Return the value in `answer`; an infinite load is told as a word or as a very large number."""
        if setting.what == "load" and re.fullmatch(r"[+-]?[0-9.]+([eE][+-]?\d+)?", answer):
            return "INF" if float(answer) > _INFINITE_OHM else answer
        return answer

    def _number(self, what: str, node: str, value: float, unit: str, tolerance: float) -> Setting:
        head = f"{self.source}{node}"
        return Setting(what, f"{head} {_text(value)}", f"{head}?", value, unit, tolerance)


class Rigol(_Tree):
    """Rigol DG800, DG1000Z, DG2000."""

    makers = ("rigol",)
    most_cycles = 500_000
    duty = (0.2, 0.8)  # DG1000Z; the DG800 and DG2000 go further, as far as the pulse stays long enough
    highest_hz = 1e6
    starts_low = False
    tells_end = False

    def __init__(self, channel: int) -> None:
        super().__init__(channel)
        self.source, self.out = f":SOUR{channel}:", f":OUTP{channel}"

    def preparation(self) -> tuple[Setting, ...]:
        """Return what makes a burst of square cycles wait for its trigger."""
        return (
            _words("function", f"{self.source}FUNC", "SQU", "SQUARE"),
            _words("burst mode", f"{self.source}BURS:MODE", "TRIG", "TRIGGERED"),
            _words("burst trigger", f"{self.source}BURS:TRIG:SOUR", "MAN", "MANUAL"),
            _words("level between bursts", f"{self.source}BURS:IDLE", "BOTTOM", "BOTT"),
            _words("burst", f"{self.source}BURS:STAT", "ON", "1"),
            _words("sync output", f"{self.out}:SYNC", "ON", "1"),
        )

    @property
    def trigger(self) -> str:
        """Command that starts the burst."""
        return f"{self.source}BURS:TRIG"


class Keysight(_Tree):
    """Keysight and Agilent 33200, 33500 and 33600 series. Channel 1 is named by no number: older ones know none."""

    makers = ("keysight", "agilent", "hewlett")
    most_cycles = 50_000  # 33220A; the 33500 series has 100 000 000
    duty = (0.2, 0.8)  # 33220A; the 33500 series goes further, as far as the pulse stays long enough
    highest_hz = 1e6
    starts_low = True
    tells_end = True

    def __init__(self, channel: int) -> None:
        super().__init__(channel)
        number = "" if channel == 1 else str(channel)
        self.source, self.out, self._trig = (f"SOUR{number}:" if number else ""), f"OUTP{number}", f"TRIG{number}"

    def preparation(self) -> tuple[Setting, ...]:
        """Return what makes a burst of square cycles wait for its trigger."""
        return (
            _words("function", f"{self.source}FUNC", "SQU", "SQUARE"),
            _words("burst mode", f"{self.source}BURS:MODE", "TRIG", "TRIGGERED"),
            _words("burst trigger", f"{self._trig}:SOUR", "BUS"),
            _words("burst", f"{self.source}BURS:STAT", "ON", "1"),
            _words("sync output", f"{self.out}:SYNC", "ON", "1"),
        )

    @property
    def trigger(self) -> str:
        """Command that starts the burst."""
        return "*TRG"


class Siglent(Dialect):
    """Siglent SDG800 to SDG6000X. One parameter for each command: over USB, long ones hang some of them."""

    makers = ("siglent",)
    most_cycles = 1_000_000
    duty = (0.2, 0.8)
    highest_hz = 1e6
    starts_low = True
    tells_end = False

    def preparation(self) -> tuple[Setting, ...]:
        """Return what makes a burst of square cycles wait for its trigger; the burst first, it resets the others."""
        return (
            self._set("function", "BSWV", "WVTP", "SQUARE"),
            self._set("burst", "BTWV", "STATE", "ON"),
            self._set("burst mode", "BTWV", "GATE_NCYC", "NCYC"),
            self._set("burst trigger", "BTWV", "TRSR", "MAN"),
            Setting("sync output", f"C{self.channel}:SYNC ON", f"C{self.channel}:SYNC?", ("ON",), field="SYNC"),
        )

    def square(self, frequency_hz: float, duty: float, cycles: int, phase_deg: float) -> tuple[Setting, ...]:
        """Return what sets the time course of the burst; the second one is the duty."""
        return (
            self._set("frequency", "BSWV", "FRQ", frequency_hz, "Hz", 1e-6 * frequency_hz),
            self._set("duty", "BSWV", "DUTY", 100.0 * duty, "%", 0.02),
            self._set("number of cycles", "BTWV", "TIME", float(cycles)),
            self._set("start phase", "BTWV", "STPS", phase_deg, "degrees", 0.1),
        )

    def low(self, volts: float) -> Setting:
        """Return what sets the lower level."""
        head = f"C{self.channel}:BSWV"
        return _volts("lower level", f"{head} LLEV,{_text(volts)}", f"{head}?", volts, "LLEV")

    def high(self, volts: float) -> Setting:
        """Return what sets the upper level."""
        head = f"C{self.channel}:BSWV"
        return _volts("upper level", f"{head} HLEV,{_text(volts)}", f"{head}?", volts, "HLEV")

    def output(self, on: bool) -> Setting:
        """Return what switches the output."""
        head = f"C{self.channel}:OUTP"
        return Setting("output", f"{head} {_BOTH[on][0]}", f"{head}?", _BOTH[on][:1], field="OUTP")

    def load(self, load: Load) -> Setting:
        """Return what tells the generator into which load it works, ohm."""
        return self._set("load", "OUTP", "LOAD", "HZ" if load == "high_z" else load)

    @property
    def trigger(self) -> str:
        """Command that starts the burst."""
        return f"C{self.channel}:BTWV MTRIG"

    def value(self, setting: Setting, answer: str) -> str | None:
        """Return one field of ``C1:BSWV WVTP,SQUARE,FRQ,10HZ,...``, without its unit; of two alike, the first."""
        head, _, rest = answer.partition(" ")
        if head.upper() != setting.question.removesuffix("?").upper():
            return None
        words = rest.strip().upper().split(",")
        if setting.field in ("OUTP", "SYNC"):
            return words[0]  # the state stands first and has no name
        names = words[1::2] if head.upper().endswith(":OUTP") else words[0::2]
        values = words[2::2] if head.upper().endswith(":OUTP") else words[1::2]
        found = next((value for name, value in zip(names, values, strict=False) if name == setting.field), None)
        return None if found is None else re.sub(r"(?<=[0-9.])(HZ|V|S|SA/S)$", "", found)

    def _set(
        self, what: str, node: str, field: str, value: float | str, unit: str = "", tolerance: float = 0.0
    ) -> Setting:
        head = f"C{self.channel}:{node}"
        expected = (value,) if isinstance(value, str) else float(value)
        text = value if isinstance(value, str) else _text(value)
        return Setting(what, f"{head} {field},{text}", f"{head}?", expected, unit, tolerance, field)


DIALECTS: Final[dict[str, type[Dialect]]] = {"rigol": Rigol, "siglent": Siglent, "keysight": Keysight}
