"""The registers of an emulated EVK4, and in which order and how soon after each other they may be written.

Addresses, values after a reset and sequences as in OpenEB 5.1.1 (register map and sequences of the IMX636). A table
entry ``4:F0005442&400+1000`` is a write to address 4 that must have that value, here in the bits 400 only, after
which 1000 us must pass. The emulated camera refuses what a real one would take and then not work.
"""

from __future__ import annotations

import errno
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

__all__ = ["FACTORY_CODES", "Operation", "Refused", "RegisterFile"]

_NS_PER_US: Final = 1000
_WHOLE: Final = 0xFFFFFFFF
_RESET_LINE: Final = 0x400004

ROI_CTRL: Final = 0x0004
ROI_APPLY: Final = 1 << 5  # clears itself
PIXELS_RELEASED: Final = 1 << 10
_TIME_BASE: Final = 0x9008
_TIME_RUNS: Final = 1
_LAST_ROW_WORD: Final = 0x4058

#: Bias registers, and the codes that a unit came with.
FACTORY_CODES: Final[Mapping[int, int]] = {0x1004: 83, 0x100C: 0, 0x1010: 102, 0x1014: 77, 0x1018: 73, 0x1020: 20}

_DEFAULTS: Final = """
    4:F0005040 C:0 10:0 14:A0401806 18:0 20:0 34:0 38:0 3C:2CF04FF 44:CCFFFCCF 4C:7640 50:0 54:210 5C:80 74:2
    78:4001DF48 88:0 8C:0 90:0 94:0 98:0 C8:100 1004:3A1E800 100C:3A1FF00 1010:1A16300 1014:1A1504D 1018:1A13700
    1020:3829614 1100:0 6000:0 6004:0 6008:80 600C:80 6028:0 602C:0 6050:0 6060:0 6070:0 7000:FFFF0001 7004:400
    8000:80 9000:208 9004:1E 9008:640 900C:0 9010:0 9014:0 9028:0 902C:0 9030:140 9034:280 9038:3C0 903C:500 9040:0
    9044:B4 9048:168 904C:21C 9050:2D0 9054:4 9058:3E8 9244:0 B000:158 B020:2000 B024:40 B028:7D0 B02C:A B030:0
    C000:0 C004:34 C008:89C0F C0C0:A05A5A0 C0C4:0 C0D4:4 C0D8:3E8 C0DC:0 C0E0:0 C0E4:0 C0E8:0 D000:0 D004:4E20
    D008:30D40 D00C:22D D0C0:A118004 D0C4:0 D0D4:4 D0D8:3E8 D0DC:0 D0E0:0 D0E4:0 D0E8:0 D0EC:0 E000:104 E020:1000
    E024:40 E02C:A E030:0 E150:0 F128:0 400004:0
"""
#: First address and number of registers that stand in a row and are 0 after a reset.
_ARRAYS: Final = (
    (0x2000, 40), (0x4000, 23), (0x6080, 8), (0x60C0, 8), (0x6400, 256), (0x6800, 230), (0x9100, 64), (0x9200, 16),
)  # fmt: skip

_INIT: Final = """
    1C:1+1000000 400004:1+500000 400004:0+1000000 B000:158+300 B044:0 B004:A B040:0 B0C8:0 B040:0 B040:0 0:4F006442
    0:F006442 B8:400 B8:400 B07C:0 B074:2 B078:A0 C0:110 C0:210 B120:1 E120:0 B068:4 B07C:1+10 B07C:3+1000 B8:401
    B8:409 0:4F006442 0:4F00644A B080:77 B084:F B088:37 B08C:37 B090:DF B094:57 B098:37 B09C:67 B0A0:37 B0A4:2F
    B0AC:28 B0CC:1 B000:2F8 B004:8A B01C:30 B020:2000 B02C:FF B030:3E80 B028:FA0 A000:B0501+200 A008:2405+200
    A004:B0501+200 A020:150+200 B040:7 B064:6 B040:F+100 B004:8A+200 B0C8:3+200 B044:1 B000:2F9 7008:1 7000:70001
    8000:1E085 9008:644 4:F0005042 18:200 1014:11A1504D 9004:0+1000 9000:200
"""
_START: Final = "B000:2F9 9028:0 9008:645&1 2C:22C724 4:F0005442&400"
_STOP: Final = "4:F0005042&400 2C:22C324 9028:2+1000 9008:644&1 B000:2F8+300"
_DESTROY: Final = """
    70:400008 6C:EE47114+500 A00C:20400+500 A010:8068+200 1104:0+200 A020:50+200 A004:B0500+200 A008:2404+200
    A000:B0500 B044:0 B004:A B040:E B0C8:0 B040:6 B040:4 0:4F006442 0:F006442 B8:401 B8:400 B07C:0
"""
_MONITORING: Final = """
    4C:1&1 4C:2&2 54:2&2+100 5C:2&2 5C:1&1+100 4C:0&2 74:1&1+20 74:2&2+1020 C:1&1+1000 C:2&2+1000 C:4&4
"""
#: Registers of the sequences that may be written outside of them as well.
_SHARED: Final = frozenset({0x4C, 0x54, 0x5C, 0x74, 0xC, 0x1014, 0x7000, 0x8000})


class Refused(Exception):
    """The camera answers that it will not."""

    def __init__(self, code: int, why: str) -> None:
        super().__init__(why)
        self.code = code


@dataclass(frozen=True, slots=True)
class Operation:
    """A register that was read or written."""

    kind: str  #: "read" or "write"
    address: int
    value: int
    time_ns: int


@dataclass(frozen=True, slots=True)
class _Step:
    address: int
    value: int
    mask: int
    wait_ns: int

    def fits(self, address: int, value: int) -> bool:
        return address == self.address and value & self.mask == self.value & self.mask


@dataclass(frozen=True, slots=True)
class _Sequence:
    name: str
    steps: tuple[_Step, ...]
    may_begin: frozenset[str]  #: in which states
    during: str  #: the state meanwhile, also if it breaks off
    then: str  #: the state afterwards


def _steps(table: str) -> tuple[_Step, ...]:
    found = []
    for word in table.split():
        match = re.fullmatch(r"(\w+):(\w+)(?:&(\w+))?(?:\+(\d+))?", word)
        if match is None:
            raise ValueError(f"table entry {word!r}")
        address, value, mask = (int(part, 16) if part else _WHOLE for part in match.groups()[:3])
        found.append(_Step(address, value, mask, int(match[4] or 0) * _NS_PER_US))
    return tuple(found)


_ANY: Final = frozenset({"off", "ready", "streaming"})
_SEQUENCES: Final = {
    "init": _Sequence("init", _steps(_INIT), frozenset({"off"}), "off", "ready"),
    "start": _Sequence("start", _steps(_START), frozenset({"ready"}), "streaming", "streaming"),
    "stop": _Sequence("stop", _steps(_STOP), _ANY, "", "ready"),
    "destroy": _Sequence("destroy", _steps(_DESTROY), frozenset({"off", "ready"}), "off", "off"),
    "monitoring": _Sequence("monitoring", _steps(_MONITORING), frozenset({"ready"}), "ready", "ready"),
}
_OF_SEQUENCES: Final = frozenset(step.address for s in _SEQUENCES.values() for step in s.steps)


class RegisterFile:
    """All registers of an EVK4.

    Attributes
    ----------
    log
        What was read and written since it was made.
    state
        "off", "ready" or "streaming".
    """

    def __init__(self, factory_codes: Mapping[int, int] = FACTORY_CODES) -> None:
        self.log: list[Operation] = []
        self.state = "off"
        self.live: dict[int, Callable[[int], int]] = {}  #: what a register reads, from what was written
        self.on_write: Callable[[int, int], None] | None = None  #: told address and value of what was written
        self._factory_codes = factory_codes
        self._values: dict[int, int] = {}
        self._sequence: _Sequence | None = None
        self._next = 0
        self._not_before_ns = 0
        self._reset()

    @property
    def values(self) -> dict[int, int]:
        """What stands in the registers."""
        return dict(self._values)

    def read(self, address: int, now_ns: int) -> int:
        """Return a register.

        Raises
        ------
        Refused
            There is none.
        """
        value = self._value(address)
        if address in self.live:
            value = self.live[address](value)
        self.log.append(Operation("read", address, value, now_ns))
        return value

    def write(self, address: int, value: int, now_ns: int) -> None:
        """Set a register.

        Raises
        ------
        Refused
            There is none, it is not its turn, or it is too soon.
        """
        before = self._value(address)
        self._require_turn(address, value, before, now_ns)
        self.log.append(Operation("write", address, value, now_ns))
        if address == _RESET_LINE and value == 1:
            self._reset()
        self._values[address] = value & ~ROI_APPLY if address == ROI_CTRL else value
        if self.on_write is not None:
            self.on_write(address, value)

    def _value(self, address: int) -> int:
        if address not in self._values:
            raise Refused(errno.ENXIO, f"no register 0x{address:X}")
        return self._values[address]

    def _reset(self) -> None:
        kept = {a: v for a, v in self._values.items() if a in (0x1C, _RESET_LINE)}
        self._values = dict.fromkeys(_OF_SEQUENCES, 0)
        for first, count in _ARRAYS:
            self._values |= dict.fromkeys(range(first, first + 4 * count, 4), 0)
        self._values[_LAST_ROW_WORD] = 0x00FF0000
        for word in _DEFAULTS.split():
            place, _, value = word.partition(":")
            self._values[int(place, 16)] = int(value, 16)
        for address, code in self._factory_codes.items():
            self._values[address] = self._values[address] & ~0xFF | code
        self._values |= kept

    def _require_turn(self, address: int, value: int, before: int, now_ns: int) -> None:
        """Go on with a sequence, begin one, or see to it that the write belongs to none."""
        stop = _SEQUENCES["stop"]
        if stop.steps[0].fits(address, value) and not self._is_next(address, value):
            self._begin(stop, now_ns)  # at any time: it is how one begins after something went wrong
            return
        if now_ns < self._not_before_ns:
            raise Refused(errno.EBUSY, f"0x{address:X} {self._not_before_ns - now_ns} ns too soon")
        if self._is_next(address, value):
            self._go_on(now_ns)
            return
        if self._sequence is stop and self._next == 1 and self.state != "streaming":
            self._sequence = None  # it was no stop, but the window of a sensor that is stopped
        if self._sequence is not None:
            raise Refused(errno.EPROTO, f"0x{address:X} in the middle of {self._sequence.name}")
        for sequence in _SEQUENCES.values():
            first = sequence.steps[0]
            if first.fits(address, value) and self.state in sequence.may_begin and self._begins(sequence, before):
                self._begin(sequence, now_ns)
                return
        self._require_free(address, value)

    def _is_next(self, address: int, value: int) -> bool:
        return self._sequence is not None and self._sequence.steps[self._next].fits(address, value)

    @staticmethod
    def _begins(sequence: _Sequence, before: int) -> bool:
        """Return whether a write begins a sequence: the thermometer is switched on once, and used often."""
        return sequence.name != "monitoring" or not before & 1

    def _begin(self, sequence: _Sequence, now_ns: int) -> None:
        self._sequence, self._next = sequence, 0
        self.state = sequence.during or self.state
        self._go_on(now_ns)

    def _go_on(self, now_ns: int) -> None:
        sequence = self._sequence
        if sequence is None:
            return
        self._not_before_ns = now_ns + sequence.steps[self._next].wait_ns
        self._next += 1
        if self._next == len(sequence.steps):
            if sequence.name != "stop" or self.state == "streaming":
                self.state = sequence.then
            self._sequence = None

    def _require_free(self, address: int, value: int) -> None:
        """Raise unless a register may be written outside of all sequences."""
        if self.state == "off":
            raise Refused(errno.EPROTO, f"0x{address:X} while the sensor is off")
        streaming = self.state == "streaming"
        if address == ROI_CTRL and bool(value & PIXELS_RELEASED) == streaming:
            return
        if address == _TIME_BASE and bool(value & _TIME_RUNS) == streaming:
            return
        if address in _OF_SEQUENCES and address not in _SHARED:
            raise Refused(errno.EPROTO, f"0x{address:X} out of turn")
