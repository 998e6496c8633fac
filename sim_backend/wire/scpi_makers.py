"""Emulated function generators in the languages of three makers."""

from __future__ import annotations

import contextlib
import re
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from protocols.errors import InputError
from sim_backend.wire.scpi_generator import OPEN_OHM, UNKNOWN, EmulatedGenerator, number_in, switched
from sim_backend.wire.scpi_samples import Refused, shares_of

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from sim_backend.world import OpticalBench

__all__ = ["EmulatedKeysight", "EmulatedRigol", "EmulatedSiglent", "emulated_generator"]

#: Fewer samples than this a Rigol stretches to so many, where it goes by their frequency.
_STRETCHED: Final = 8192


class _EmulatedTree(EmulatedGenerator):
    """Commands in a tree; `digits` of a number are told."""

    def _setters(self) -> dict[str, Callable[[str], None]]:
        settings = self.settings

        def store(name: str, words: dict[str, str]) -> Callable[[str], None]:
            def set_word(text: str) -> None:
                if text not in words:
                    raise ValueError(text)
                setattr(settings, name, words[text])

            return set_word

        def switch(name: str) -> Callable[[str], None]:
            def set_switch(text: str) -> None:
                setattr(settings, name, switched(text))

            return set_switch

        return {
            "FUNC": store("function", {"SQU": "SQU", "SQUARE": "SQU", "SIN": "SIN", "ARB": "ARB", "USER": "USER"}),
            "FUNC:ARB:SRAT": lambda text: self._set_rate(number_in(text)),
            "FREQ": lambda text: self._set_frequency(number_in(text)),
            "VOLT:LOW": lambda text: self._set_levels(low_v=number_in(text)),
            "VOLT:HIGH": lambda text: self._set_levels(high_v=number_in(text)),
            "FUNC:SQU:DCYC": lambda text: self._set_duty(number_in(text) / 100.0),
            "BURS:STAT": switch("burst"),
            "BURS:MODE": store("burst_mode", {"TRIG": "TRIG", "GAT": "GAT"}),
            "BURS:NCYC": lambda text: self._set_cycles(number_in(text)),
            "BURS:PHAS": lambda text: setattr(settings, "phase_deg", number_in(text)),
            "OUTP": switch("output"),
            "OUTP:LOAD": lambda text: self._set_load(OPEN_OHM if text == "INF" else number_in(text)),
            "OUTP:SYNC": switch("sync"),
        } | self._more_setters(store)

    def _more_setters(
        self, store: Callable[[str, dict[str, str]], Callable[[str], None]]
    ) -> dict[str, Callable[[str], None]]:
        raise NotImplementedError

    def _getters(self) -> dict[str, str]:
        settings = self.settings
        return {
            "FUNC": settings.function,
            "FREQ": self._told(settings.frequency_hz),
            "FUNC:ARB:SRAT": self._told(settings.sample_rate_hz),
            "VOLT:LOW": self._told(settings.low_v),
            "VOLT:HIGH": self._told(settings.high_v),
            "FUNC:SQU:DCYC": self._told(100.0 * settings.duty),
            "BURS:STAT": self._told_switch(settings.burst),
            "BURS:MODE": settings.burst_mode,
            "BURS:NCYC": self._told_count(settings.cycles),
            "BURS:PHAS": self._told(settings.phase_deg),
            "OUTP": self._told_switch(settings.output),
            "OUTP:LOAD": self._told(settings.load_ohm),
            "OUTP:SYNC": self._told_switch(settings.sync),
        } | self._more_getters()

    def _more_getters(self) -> dict[str, str]:
        raise NotImplementedError

    def _told(self, number: float) -> str:
        raise NotImplementedError

    def _told_count(self, number: int) -> str:
        return self._told(float(number))

    def _told_switch(self, on: bool) -> str:
        raise NotImplementedError

    def _node(self, head: str) -> str:
        """Return a head without its channel; raise `KeyError` if it is of another one."""
        raise NotImplementedError

    def _own(self, line: str) -> str:
        head, _, value = line.upper().partition(" ")
        try:
            node = self._node(head.removesuffix("?"))
            if head.endswith("?"):
                return self._getters()[node]
            if node == "trigger":
                self._trigger()
            else:
                self._setters()[node](value.strip())
        except KeyError:
            self._error(UNKNOWN)
        return ""


class EmulatedRigol(_EmulatedTree):
    """A Rigol DG1000Z: numbers with 7 digits, switches in words, levels that it cannot reach refused."""

    identity = "Rigol Technologies,DG1062Z,DG1ZA000000001,03.01.12"
    _part: npt.NDArray[np.float64] = np.empty(0)  #: blocks of samples that are not all there

    def _take_in(self, head: str, data: bytes) -> None:
        """Take a block; after the last one it plays the samples, stretched where it goes by their frequency."""
        flag = re.fullmatch(r":SOUR1:TRAC:DATA:DAC16 VOLATILE,(CON|END),#\d+", head.upper())
        if flag is None:
            raise Refused(head)
        self._part = np.concatenate([self._part, shares_of(data, "<u2", 0, 0x3FFF, 8, 16_384)])
        if flag[1] == "CON":
            return
        samples, self._part = self._part, np.empty(0)
        settings = self.settings
        if settings.sample_mode == "FREQ" and len(samples) < _STRETCHED:
            places = np.arange(_STRETCHED) / _STRETCHED * len(samples)
            samples = np.interp(places, np.arange(len(samples)), samples)
        settings.memory["VOLATILE"], settings.samples, settings.function = samples, "VOLATILE", "USER"

    def reboot(self, send: Callable[[bytes], None]) -> None:
        """Lose the power for a moment, and with it what came of samples."""
        self._part = np.empty(0)
        super().reboot(send)

    def _node(self, head: str) -> str:
        match = re.fullmatch(r":SOUR1:(.+)|:(OUTP)1(:.+)?", head)
        if match is None:
            raise KeyError(head)
        node = match[1] or match[2] + (match[3] or "")
        return "trigger" if node == "BURS:TRIG" else node

    def _more_setters(
        self, store: Callable[[str, dict[str, str]], Callable[[str], None]]
    ) -> dict[str, Callable[[str], None]]:
        return {
            "BURS:TRIG:SOUR": store("burst_trigger", {"INT": "INT", "EXT": "EXT", "MAN": "MAN"}),
            "BURS:IDLE": store("idle", {word: word for word in ("FPT", "TOP", "CENTER", "BOTTOM")}),
            "FUNC:ARB:MODE": store("sample_mode", {"FREQ": "FREQ", "SRATE": "RATE", "SRAT": "RATE"}),
        }

    def _more_getters(self) -> dict[str, str]:
        settings = self.settings
        return {
            "BURS:TRIG:SOUR": settings.burst_trigger,
            "BURS:IDLE": settings.idle,
            "FUNC:ARB:MODE": "SRATE" if settings.sample_mode == "RATE" else "FREQ",
            "DATA:POIN": str(len(settings.memory.get("VOLATILE", ()))),
        }

    def _told(self, number: float) -> str:
        return f"{number:.6E}"

    def _told_count(self, number: int) -> str:
        return str(number)

    def _told_switch(self, on: bool) -> str:
        return "ON" if on else "OFF"


class EmulatedKeysight(_EmulatedTree):
    """A Keysight 33500 series: numbers with a sign and 14 digits, switches as 0 and 1, the trigger ``*TRG``."""

    identity = "Agilent Technologies,33521A,MY50000001,2.03-1.19-2.00-52-00"
    no_error = '+0,"No error"'

    def _common(self, line: str) -> str | None:
        if line == "*TRG":
            self._trigger()
            return ""
        return super()._common(line)

    def _node(self, head: str) -> str:
        return re.sub(r"^:?(SOUR1?:)?", "", re.sub(r"^:?(OUTP|TRIG)1", r"\1", head))

    def _more_setters(
        self, store: Callable[[str, dict[str, str]], Callable[[str], None]]
    ) -> dict[str, Callable[[str], None]]:
        return {
            "TRIG:SOUR": store("burst_trigger", {"IMM": "INT", "EXT": "EXT", "BUS": "BUS"}),
            "FORM:BORD": store("byte_order", {"NORM": "NORM", "SWAP": "SWAP"}),
            "FUNC:ARB": store("samples", {name: name for name in self.settings.memory}),
            "FUNC:ARB:FILT": store("sample_filter", {word: word for word in ("NORM", "STEP", "OFF")}),
            "DATA:VOL:CLE": lambda _: self.settings.memory.clear(),
        }

    def _take_in(self, head: str, data: bytes) -> None:
        """Take samples under a name; one that is known is refused."""
        name = re.fullmatch(r"DATA:ARB:DAC (\w{1,12}),#\d+", head.upper())
        if name is None or name[1] in self.settings.memory:
            raise Refused(head)
        kind = ">i2" if self.settings.byte_order == "NORM" else "<i2"
        self.settings.memory[name[1]] = shares_of(data, kind, -32_767, 32_767, 8, 1_000_000)
        self.settings.sample_mode = "RATE"  # it knows no other

    def _more_getters(self) -> dict[str, str]:
        trigger = self.settings.burst_trigger
        settings = self.settings
        return {
            "TRIG:SOUR": "IMM" if trigger == "INT" else trigger,
            "FORM:BORD": settings.byte_order,
            "FUNC:ARB": f'"{settings.samples}"',
            "FUNC:ARB:FILT": settings.sample_filter,
            "DATA:ATTR:POIN": self._told(float(len(next(iter(settings.memory.values()), ())))),
        }

    def _told(self, number: float) -> str:
        return f"{number:+.14E}"

    def _told_switch(self, on: bool) -> str:
        return "1" if on else "0"


class EmulatedSiglent(EmulatedGenerator):
    """A Siglent SDG2000X: all of a group in one answer, what it cannot reach silently changed."""

    identity = "Siglent Technologies,SDG2042X,SDG2XCAX000001,2.01.01.35R3B2"

    def obey(self, request: bytes, send: Callable[[bytes], None]) -> None:
        """Do what a line asks; samples are sent as they were taken."""
        asked = re.fullmatch(rb"WVDT\? USER,(\w+)\s*", request, re.IGNORECASE)
        if asked is None:
            super().obey(request, send)
            return
        name = asked[1].decode().upper()
        samples = self.settings.memory.get(name)
        if samples is None:
            self._error(UNKNOWN)
            return
        data = np.rint(samples * 65_534 - 32_767).astype("<i2").tobytes()
        head = f"WVDT POS, M50, WVNM, {name}, LENGTH, {len(data)}B, TYPE, 5, WAVEDATA,"
        send(head.encode() + data + b"\n")

    def _take_in(self, head: str, data: bytes) -> None:
        """Take samples under a name, in place of others; what it does not take it leaves without a word."""
        name = re.match(r"C1:WVDT WVNM,(\w{1,30}),", head.upper())
        with contextlib.suppress(Refused):
            if name is not None:
                self.settings.memory[name[1]] = shares_of(data, "<i2", -32_767, 32_767, 8, 8_000_000)

    def _own(self, line: str) -> str:
        match = re.fullmatch(r"C1:(BSWV|BTWV|OUTP|SYNC|ARWV|SRATE)(\?| (.+))", line.upper())
        if match is None:
            self._error(UNKNOWN)
            return ""
        group, words = match[1], (match[3] or "").split(",")
        if match[2] == "?":
            return f"C1:{group} {self._told(group)}"
        if words == ["MTRIG"] and group == "BTWV":
            self._trigger()
        elif group in ("OUTP", "SYNC") and words[0] in ("ON", "OFF"):
            setattr(self.settings, {"OUTP": "output", "SYNC": "sync"}[group], words[0] == "ON")
        else:
            for name, value in zip(words[0::2], words[1::2], strict=True):
                self._set(group, name, value)
        return ""

    def _set(self, group: str, name: str, value: str) -> None:
        settings, before = self.settings, len(self._errors)
        if (group, name) == ("BSWV", "WVTP"):
            settings.function = {"SQUARE": "SQU", "ARB": "ARB"}.get(value, "SIN")
        elif (group, name) == ("ARWV", "NAME"):
            settings.samples = value if value in settings.memory else settings.samples
        elif (group, name) == ("SRATE", "MODE"):
            settings.sample_mode = "RATE" if value == "TARB" else "FREQ"
        elif (group, name) == ("SRATE", "INTER"):
            settings.between_samples = value
        elif (group, name) == ("BTWV", "STATE"):
            settings.burst = switched(value)
            settings.cycles, settings.phase_deg, settings.burst_trigger = 1, 0.0, "INT"
        elif (group, name) == ("BTWV", "TRSR"):
            settings.burst_trigger = value
        elif (group, name) == ("BTWV", "GATE_NCYC"):
            settings.burst_mode = value
        elif (group, name) == ("OUTP", "LOAD"):
            self._set_load(OPEN_OHM if value == "HZ" else number_in(value))
        elif (setter := self._number_setters().get((group, name))) is not None:
            setter(number_in(value.removesuffix("HZ").rstrip("VS")))
        else:
            self._error(UNKNOWN)
        del self._errors[before:]  # what is out of range is changed or left without a word

    def _number_setters(self) -> dict[tuple[str, str], Callable[[float], None]]:
        settings = self.settings
        return {
            ("BSWV", "FRQ"): self._set_frequency,
            ("SRATE", "VALUE"): self._set_rate,
            ("BSWV", "HLEV"): lambda volts: self._set_levels(high_v=volts),
            ("BSWV", "LLEV"): lambda volts: self._set_levels(low_v=volts),
            ("BSWV", "DUTY"): lambda percent: self._set_duty(percent / 100.0),
            ("BTWV", "TIME"): self._set_cycles,
            ("BTWV", "STPS"): lambda degrees: setattr(settings, "phase_deg", degrees),
        }

    def _told(self, group: str) -> str:
        settings = self.settings
        kind = {"SQU": "SQUARE", "ARB": "ARB"}.get(settings.function, "SINE")
        wave = (
            f"WVTP,{kind},FRQ,{settings.frequency_hz:.12g}HZ,"
            f"PERI,{1.0 / settings.frequency_hz:.9g}S,AMP,{settings.high_v - settings.low_v:.6g}V,"
            f"OFST,{(settings.high_v + settings.low_v) / 2.0:.6g}V,HLEV,{settings.high_v:.6g}V,"
            f"LLEV,{settings.low_v:.6g}V,PHSE,0,DUTY,{100.0 * settings.duty:.10g}"
        )
        if group == "BSWV":
            return wave
        if group == "OUTP":
            load = "HZ" if settings.load_ohm == OPEN_OHM else f"{settings.load_ohm:.0f}"
            return f"{'ON' if settings.output else 'OFF'},LOAD,{load},PLRT,NOR"
        if group == "ARWV":
            return f"INDEX,60,NAME,{settings.samples}"
        if group == "SRATE":
            rate = f"MODE,TARB,VALUE,{settings.sample_rate_hz:.12g}Sa/s,INTER,{settings.between_samples}"
            return rate if settings.sample_mode == "RATE" else "MODE,DDS"
        if group == "SYNC":
            return "ON" if settings.sync else "OFF"
        if not settings.burst:
            return "STATE,OFF"
        return (
            f"STATE,ON,PRD,0.01S,STPS,{settings.phase_deg:.10g},TRSR,{settings.burst_trigger},TRMD,OFF,"
            f"TIME,{settings.cycles},DLAY,2.4e-07S,GATE_NCYC,{settings.burst_mode},CARR,{wave}"
        )


def emulated_generator(
    world: OpticalBench,
    dialect: str,
    *,
    wired_to: Literal["high_z", 50] = "high_z",
    rise_tau_s: float = 0.0,
) -> EmulatedGenerator:
    """Return a generator that speaks `dialect`: rigol, siglent or keysight."""
    makers: dict[str, type[EmulatedGenerator]] = {
        "rigol": EmulatedRigol,
        "siglent": EmulatedSiglent,
        "keysight": EmulatedKeysight,
    }
    if dialect not in makers:
        raise InputError(f"emulated generator: dialect is {dialect!r}; expected {', '.join(makers)}")
    return makers[dialect](world, wired_to=wired_to, rise_tau_s=rise_tau_s)
