"""What the sensor must be told, in which order and with which pauses, to power up, start, stop and power down.

The steps are those of OpenEB 5.1.1 (Apache-2.0; hal_psee_plugins, devices/imx636, and the facilities that follow).
In the tables, ``0004=F0005442`` writes a register, ``0004=400/400`` changes its bits under a mask and keeps the
others, ``2000*40=0`` writes consecutive registers, and ``~1000`` waits so many us.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Iterable

    from drivers.camera.evk4.registers import Registers
    from drivers.interfaces import Clock

__all__ = [
    "DESTROY",
    "EVENT_RATE_CONTROLLER",
    "INIT",
    "MONITORING",
    "PIXELS_AND_TIME_BASE",
    "START",
    "STOP",
    "Change",
    "Step",
    "Wait",
    "Write",
    "run",
]


@dataclass(frozen=True, slots=True)
class Write:
    """Set all bits of a register."""

    address: int
    value: int


@dataclass(frozen=True, slots=True)
class Change:
    """Set the bits under a mask, and keep the others."""

    address: int
    value: int
    mask: int


@dataclass(frozen=True, slots=True)
class Wait:
    """Let time pass."""

    us: int


Step: TypeAlias = Write | Change | Wait


def run(steps: Iterable[Step], registers: Registers, clock: Clock) -> None:
    """Do the steps one after the other."""
    for step in steps:
        if isinstance(step, Write):
            registers.write(step.address, step.value)
        elif isinstance(step, Change):
            registers.change(step.address, step.value, step.mask)
        else:
            clock.sleep(step.us * 1e-6)


def _steps(table: str) -> tuple[Step, ...]:
    """Read a table."""
    steps: list[Step] = []
    for word in table.split():
        if word.startswith("~"):
            steps.append(Wait(int(word[1:])))
            continue
        place, _, value = word.partition("=")
        first, _, count = place.partition("*")
        number, _, mask = value.partition("/")
        for address in range(int(first, 16), int(first, 16) + 4 * int(count or 1), 4):
            one = Write(address, int(number, 16))
            steps.append(Change(one.address, one.value, int(mask, 16)) if mask else one)
    return tuple(steps)


#: From no power to ready: clocks, reset, MIPI, regulators, event format EVT3, time base.
INIT: Final = _steps("""
    001C=00000001 ~1000000 400004=00000001 ~500000 400004=00000000 ~1000000 B000=00000158 ~300 B044=00000000
    B004=0000000A B040=00000000 B0C8=00000000 B040=00000000 B040=00000000 0000=4F006442 0000=0F006442 00B8=00000400
    00B8=00000400 B07C=00000000 B074=00000002 B078=000000A0 00C0=00000110 00C0=00000210 B120=00000001 E120=00000000
    B068=00000004 B07C=00000001 ~10 B07C=00000003 ~1000 00B8=00000401 00B8=00000409 0000=4F006442 0000=4F00644A
    B080=00000077 B084=0000000F B088=00000037 B08C=00000037 B090=000000DF B094=00000057 B098=00000037 B09C=00000067
    B0A0=00000037 B0A4=0000002F B0AC=00000028 B0CC=00000001 B000=000002F8 B004=0000008A B01C=00000030 B020=00002000
    B02C=000000FF B030=00003E80 B028=00000FA0 A000=000B0501 ~200 A008=00002405 ~200 A004=000B0501 ~200 A020=00000150
    ~200 B040=00000007 B064=00000006 B040=0000000F ~100 B004=0000008A ~200 B0C8=00000003 ~200 B044=00000001
    B000=000002F9 7008=00000001 7000=00070001 8000=0001E085 9008=00000644 0004=F0005042 0018=00000200 1014=11A1504D
    9004=00000000 ~1000 9000=00000200
""")

#: From ready to streaming; the last step releases the pixels.
START: Final = _steps("B000=000002F9 9028=00000000 9008=645/1 002C=0022C724 0004=F0005442/400")

#: From streaming to ready; the first step holds the pixels.
STOP: Final = _steps("0004=F0005042/400 002C=0022C324 9028=00000002 ~1000 9008=644/1 B000=000002F8 ~300")

#: From stopped to no power.
DESTROY: Final = _steps("""
    0070=00400008 006C=0EE47114 ~500 A00C=00020400 ~500 A010=00008068 ~200 1104=00000000 ~200 A020=00000050 ~200
    A004=000B0500 ~200 A008=00002404 ~200 A000=000B0500 B044=00000000 B004=0000000A B040=0000000E B0C8=00000000
    B040=00000006 B040=00000004 0000=4F006442 0000=0F006442 00B8=00000401 00B8=00000400 B07C=00000000
""")

#: The thermometer and the measurement of the light.
MONITORING: Final = _steps("""
    004C=1/1 004C=2/2 0054=2/2 ~100 005C=2/2 005C=1/1 ~100 004C=0/2 0074=1/1 ~20 0074=2/2 ~20 ~1000 000C=1/1 ~1000
    000C=2/2 ~1000 000C=4/4
""")

#: The event-rate controller is made ready, but does not drop anything.
EVENT_RATE_CONTROLLER: Final = (
    *_steps("6000=0/3 6004=1/1 6008=C8/3FF 600C=FA0/3FFFFF 6028=3/7 602C=1/1 6800*230=08080808 602C=0/1"),
    *(Write(0x6400 + 4 * i, 2 * i | 2 * i + 1 << 16) for i in range(256)),
    *_steps("6050=0/1 6060=0/1 6070=0/1 6000=1/3"),
)

#: All pixels on, the trigger input off, and the time base by the camera's own clock, in us.
PIXELS_AND_TIME_BASE: Final = _steps("""
    2000*40=0 4000*22=0 4058=0/FFFF 7004=0/400 9008=0/2 9008=4/4 9008=0/8 9008=640/7F0
""")
