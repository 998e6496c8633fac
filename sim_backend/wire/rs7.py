"""The firmware of a SpectralLED RS-7, as its manual describes it.

Source: Gamma Scientific, SpectralLED RS-7 User Manual, rev. A/X1 (2018), firmware 1.12, chapter 4. The manual leaves
open when after the acknowledgement the light moves, how some answers are laid out (`CAL`, `SDC`, `ALA`, `TMP`, `ATF`)
and how errors are worded: what is here is an assumption there. Spectra are not transferred in binary (`STM 2`).
"""

from __future__ import annotations

import math
import time
from functools import partial
from typing import TYPE_CHECKING, Final

from protocols.errors import InputError
from sim_backend.clock import NS_PER_S
from sim_backend.wire.wire import Firmware

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sim_backend.world import OpticalBench

__all__ = ["Rs7Firmware"]

_CR: Final = 0x0D
_REPEAT: Final = 0x01
_BUFFER: Final = 8192
_OVERFLOW: Final = b"\x00overflow"
_CHANNELS: Final = 64
_PRESET_CHANNELS: Final = range(1, 33)
_LOWEST_WITH_FEEDBACK: Final = 20.0  # cd/m2
_WAVELENGTHS_NM: Final = (360, 1100)
_LUMENS_PER_WATT: Final = 250.0  # of the emulated spectrum
_STAMP_WAIT_S: Final = 0.2
_RANGES: Final = {"UNI": (0, 2), "IRR": (0, 10_000), "STP": (0.01, 100.0), "SLM": (1, 100)}
_RANGES.update(dict.fromkeys(("FBK", "STM", "ASA", "GRP"), (0, 1)))
_REPORTS: Final = {"VER": "1.12", "CAL": "2018-05-04,9D3C11F0", "SDC": "9D3C11F0", "TMP": "25.0,25.1", "FBG": "1.000"}
_OK: Final = b"Ok\r\n"
_BANNER: Final = b"SpectralLED RS-7-1\r\nFirmware Version 1.12\r\nOk\r\n"
_TEXTS: Final = {
    "01": "Missing argument",
    "02": "Argument out of range",
    "03": "Unknown command",
    "04": "Input buffer overflow",
    "10": "Soft power limit exceeded",
    "16": "Output spectrum is zero",
    "17": "No such preset",
    "18": "Output failed to settle within 0.5 s",
    "20": "Level too low for optical feedback",
    "24": "Level over-ranges optical feedback",
    "A1": "Channel power limit reached",
    "A3": "Output less than half or more than twice expected",
    "A4": "Optical feedback lock lost",
    "A5": "LED temperature off by more than 1 C",
    "A6": "LED temperature above 40 C, LEDs shut down",
    "A7": "LED temperature below 19.5 C for 15 s",
    "F1": "Fault",
}
_OBEYED_IN_A_FAULT: Final = ("CFC", "ICK", "RST")


class _Refused(Exception):
    """The unit answers with an error."""

    def __init__(self, code: str) -> None:
        super().__init__(code)
        self.code = code


class Rs7Firmware(Firmware):
    """A unit that is switched on when it is made: with its preset 0, which is lit unless its level is 0.

    Parameters
    ----------
    world
        The world that is lit, and its clock.
    latency_s
        From the acknowledgement of a level until the light steps, s.
    settling_s
        From the step until the unit answers Ok, s.
    rise_tau_s
        Time constant of an edge, s.
    photodiode
        Whether a photodiode looks at the light and sends a trigger edge at each step of it.
    presets
        Luminance by name, in the order of their numbers, cd/m2; 0 is dark. None for one of 1000 cd/m2.
    attenuator
        Name of the attenuating filter that is declared in the unit; empty for none.
    full_cd_m2
        Luminance that the unit reaches, cd/m2.
    calibration
        "R" (radiance), "I" (irradiance) or "F" (flux).
    serial
        Serial number.
    on_for_s
        Since when it has been on, s.
    alarm_code
        Of the alarm that it raises when it is made to.
    """

    def __init__(
        self,
        world: OpticalBench,
        *,
        latency_s: float = 2e-3,
        settling_s: float = 0.05,
        rise_tau_s: float = 0.0,
        photodiode: bool = False,
        presets: Mapping[str, float] | None = None,
        attenuator: str = "",
        full_cd_m2: float = 15000.0,
        calibration: str = "R",
        serial: str = "HX2855",
        on_for_s: float = 7768.736,
        alarm_code: str = "A5",
    ) -> None:
        for what, value in {"latency_s": latency_s, "settling_s": settling_s, "rise_tau_s": rise_tau_s}.items():
            if not 0.0 <= value < math.inf:
                raise InputError(f"RS-7: {what} is {value}; expected 0 s or more")
        if alarm_code not in _TEXTS:
            raise InputError(f"RS-7: alarm_code is {alarm_code!r}; expected one of {', '.join(_TEXTS)}")
        world.rise_tau_s = rise_tau_s
        self.next_errors: list[str] = []  #: codes that the next commands of a level are answered with
        self.alarms: list[str] = []  #: codes of the alarms that stand
        self.in_fault = False  #: fault F1
        self._world = world
        self._latency_s = latency_s
        self._settling_s = settling_s
        self._photodiode = photodiode
        self._presets = list({"POWER ON": 1000.0}.items() if presets is None else presets.items())
        self._attenuator = attenuator
        self._full_cd_m2 = full_cd_m2
        self._commands = self._known(serial, calibration)
        self._alarm_code = alarm_code
        self._last = b""
        self._reads: int | None = None  # how often the clock had been read when a command was acknowledged
        self._on_ns = world.clock.now_ns
        self._switch_on()
        self._on_ns -= round(on_for_s * NS_PER_S)

    def _known(self, serial: str, calibration: str) -> dict[str, Callable[[list[str]], bytes]]:
        """Return what is done for each acronym, with its arguments."""
        reports = {**_REPORTS, "USN": serial, "LSN": f"L{serial}", "CTY": calibration}
        return {
            **{acronym: partial(self._setting, acronym) for acronym in _RANGES},
            **{acronym: partial(_report, text) for acronym, text in reports.items()},
            "OUT": self._out,
            "OUTC": self._out,
            "OUTA": lambda _: self._out([]),
            "SCP": self._channel_power,
            "PRE": self._load,
            "WLR": self._wavelengths,
            "ATF": self._filters,
            "OSP": lambda _: self._spectrum(),
            "ALA": lambda _: b"".join(_line(code) for code in self.alarms) + b"\r\n",
            "ALAR": lambda _: self._clear_alarms(),
            "ALAC": lambda _: self._clear_alarms(),
            "POT": lambda _: self._uptime(),
            "OCL": lambda _: _list([]),
            "ICK": lambda _: _OK,
            "CFC": lambda _: self._clear_fault(),
            "RST": lambda _: self._restart(),
        }

    def _switch_on(self) -> None:
        self._on_ns = self._world.clock.now_ns
        self._numbers = {"UNI": 0, "IRR": 0.0, "FBK": 1, "STP": 0.25, "SLM": 90.0, "STM": 0, "ASA": 1, "GRP": 1}
        self._range_nm = (380, 780)
        self._preset: int | None = 0 if self._presets else None
        self._channels = dict.fromkeys(_PRESET_CHANNELS if self._presets else (), 50.0)
        self._light(self._presets[0][1] if self._presets else 0.0)

    def requests_in(self, buffer: bytearray) -> list[bytes]:
        """Take the commands that are complete: up to a CR, or the single byte that repeats the last one."""
        found: list[bytes] = []
        start = 0
        for i, byte in enumerate(buffer):
            if byte == _REPEAT and i == start:
                found.append(bytes([_REPEAT]))
                start = i + 1
            elif byte == _CR:
                found.append(bytes(buffer[start:i]) if i - start <= _BUFFER else _OVERFLOW)
                start = i + 1
            elif byte == 0x0A and i == start:
                start = i + 1
        del buffer[:start]
        if len(buffer) > _BUFFER:
            buffer.clear()
            found.append(_OVERFLOW)
        return found

    def obey(self, request: bytes, send: Callable[[bytes], None]) -> None:
        """Acknowledge a command, do it, and answer."""
        if request == bytes([_REPEAT]):
            request = self._last
        self._last = request
        if self._numbers["ASA"] and self.alarms:
            send(b"".join(_line(code) for code in self.alarms))
        self._reads = getattr(self._world.clock, "reads", None)
        send(b"\r\n")
        try:
            answer = self._answer(request)
        except _Refused as refused:
            answer = _line(refused.code)
        send(answer)

    def reboot(self, send: Callable[[bytes], None]) -> None:
        """Lose the power for a moment: lit with preset 0, all settings forgotten."""
        self.in_fault = False
        self._switch_on()
        send(_BANNER)

    def alarm(self) -> bytes:
        """Return the line of the alarm, which stands from now on until it is cleared."""
        if self._alarm_code not in self.alarms:
            self.alarms.append(self._alarm_code)
        return _line(self._alarm_code)

    def _answer(self, request: bytes) -> bytes:
        text = request.decode("ascii", "replace").strip().upper().replace("\x1b", "")
        if request == _OVERFLOW:
            raise _Refused("04")
        if not text:
            return b""
        acronym = next((text[:n] for n in (4, 3) if text[:n] in self._commands), "")
        if self.in_fault and acronym not in _OBEYED_IN_A_FAULT:
            raise _Refused("F1")
        if not acronym:
            raise _Refused("03")
        arguments = text[len(acronym) :].replace(",", " ").split()
        return self._commands[acronym](arguments)

    def _out(self, arguments: list[str]) -> bytes:
        if not arguments:
            return _value(_text(self._world.level * self._per_cd_m2()))
        if not any(self._channels.values()):
            raise _Refused("16")
        level = _number(arguments[0]) / self._per_cd_m2()
        if level < 0.0:
            raise _Refused("02")
        if level > self._full_cd_m2:
            raise _Refused("24" if self._numbers["FBK"] else "10")
        if self._numbers["FBK"] and 0.0 < level < _LOWEST_WITH_FEEDBACK:
            raise _Refused("20")
        return self._go_to(level, None)

    def _channel_power(self, arguments: list[str]) -> bytes:
        numbers = [_number(argument) for argument in arguments]
        if not numbers:
            return _list([f"{channel},{_text(power)}" for channel, power in self._channels.items() if power])
        if len(numbers) == 1:
            return _value(_text(self._channels.get(int(numbers[0]), 0.0)))
        if len(numbers) % 2 or not all(0 <= n <= _CHANNELS for n in numbers[::2]):
            raise _Refused("02")
        if not all(0.0 <= power <= 100.0 for power in numbers[1::2]):
            raise _Refused("02")
        if any(power > self._numbers["SLM"] for power in numbers[1::2]):
            raise _Refused("10")
        for channel, power in zip(numbers[::2], numbers[1::2], strict=True):
            channels = range(1, _CHANNELS + 1) if channel == 0 else (int(channel),)
            self._channels.update(dict.fromkeys(channels, power))
        return self._go_to(self._full_cd_m2 * sum(self._channels.values()) / (100.0 * _CHANNELS), None)

    def _load(self, arguments: list[str]) -> bytes:
        if not arguments:
            return _value("NONE" if self._preset is None else str(self._preset))
        if arguments[0] == "*":
            return _list([f"{number},{name}" for number, (name, _) in enumerate(self._presets)])
        following = 0 if self._preset is None else (self._preset + 1) % max(len(self._presets), 1)
        number = following if arguments[0] == "N" else int(_number(arguments[0]))
        if not 0 <= number < len(self._presets):
            raise _Refused("17")
        self._channels = dict.fromkeys(_PRESET_CHANNELS, 50.0)
        return self._go_to(self._presets[number][1], number)

    def _go_to(self, level: float, preset: int | None) -> bytes:
        """Step to a level after the latency, settle, and answer."""
        self._let_the_acknowledgement_be_seen()
        error = self.next_errors.pop(0) if self.next_errors else ""
        if error and error != "18":
            raise _Refused(error)
        self._world.clock.sleep(self._latency_s)
        self._preset = preset
        self._light(level)
        self._world.clock.sleep(0.5 if error else self._settling_s)
        if error:
            raise _Refused(error)
        return _OK

    def _light(self, level: float) -> None:
        before = self._world.level
        self._world.set_level(level)
        if self._photodiode and level != before:
            self._world.emit_trigger(rising=level > before)

    def _let_the_acknowledgement_be_seen(self) -> None:
        """Wait, on a clock that counts how often it is read, until the driver has read it.

        Virtual time passes in no time: without this the driver might see the acknowledgement only when it is over.
        """
        deadline = time.monotonic() + _STAMP_WAIT_S
        while self._reads is not None and getattr(self._world.clock, "reads", None) == self._reads:
            if time.monotonic() > deadline:
                return
            time.sleep(2e-5)

    def _per_cd_m2(self) -> float:
        """Return what 1 cd/m2 is in the unit that is set."""
        radiance = 100.0 / _LUMENS_PER_WATT  # uW/cm2/sr
        return {0: radiance, 1: 1.0, 2: 100.0 / self._full_cd_m2}[int(self._numbers["UNI"])]

    def _setting(self, acronym: str, arguments: list[str]) -> bytes:
        if not arguments:
            return _value(_text(self._numbers[acronym]))
        lowest, highest = _RANGES[acronym]
        number = _number(arguments[0])
        if not lowest <= number <= highest:
            raise _Refused("02")
        self._numbers[acronym] = number
        return _OK

    def _wavelengths(self, arguments: list[str]) -> bytes:
        if not arguments:
            return _value("{},{}".format(*self._range_nm))
        if len(arguments) < 2:
            raise _Refused("01")
        first, last = (int(_number(argument)) for argument in arguments[:2])
        if not _WAVELENGTHS_NM[0] <= first < last <= _WAVELENGTHS_NM[1]:
            raise _Refused("02")
        self._range_nm = (first, last)
        return _OK

    def _spectrum(self) -> bytes:
        rows = [f"{density:.6g}" for density in self._density(range(self._range_nm[0], self._range_nm[1] + 1))]
        return _list(rows) if self._numbers["STM"] == 1 else _value(",".join(rows))

    def _density(self, wavelengths_nm: range) -> list[float]:
        """Return a broad peak at 550 nm that is as bright as the unit is, uW/cm2/nm/sr."""
        total = self._world.level * 100.0 / _LUMENS_PER_WATT
        return [total * math.exp(-0.5 * ((nm - 550.0) / 60.0) ** 2) / (60.0 * 2.50662827) for nm in wavelengths_nm]

    def _filters(self, arguments: list[str]) -> bytes:
        if arguments == ["*"]:
            return _list([f"1,{self._attenuator}"] if self._attenuator else [])
        if arguments:
            self._attenuator = self._attenuator if arguments[0] != "0" else ""
            return _OK
        return _value(f"1,{self._attenuator}" if self._attenuator else "NONE")

    def _clear_alarms(self) -> bytes:
        self.alarms.clear()
        return _OK

    def _clear_fault(self) -> bytes:
        self.in_fault = False
        return _OK

    def _restart(self) -> bytes:
        self.in_fault = False
        self._switch_on()
        return _BANNER

    def _uptime(self) -> bytes:
        milliseconds = (self._world.clock.now_ns - self._on_ns) // 1_000_000
        minutes, milliseconds = divmod(milliseconds, 60_000)
        hours, minutes = divmod(minutes, 60)
        days, hours = divmod(hours, 24)
        return _value(f"{days}D {hours:02d}:{minutes:02d}:{milliseconds / 1000.0:06.3f}")


def _line(code: str) -> bytes:
    return f"?{code} - {_TEXTS.get(code, 'Error')}\r\n".encode("ascii")


def _value(text: str) -> bytes:
    return text.encode("ascii") + b"\r\n"


def _report(text: str, _: list[str]) -> bytes:
    return _value(text)


def _list(rows: list[str]) -> bytes:
    return "".join(f"{row}\r\n" for row in rows).encode("ascii") + b"\r\n"


def _text(number: float) -> str:
    return f"{number:.9g}"


def _number(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        raise _Refused("02") from None
    if not math.isfinite(number):
        raise _Refused("02")
    return number
