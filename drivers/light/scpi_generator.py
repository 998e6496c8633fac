"""A function generator that speaks SCPI, with an LED behind it: it times square waves by itself."""

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING, Final

import numpy as np

from drivers.errors import ConnectionFailed, DataLost, DeviceError, UnexpectedAnswer, Unsupported
from drivers.interfaces import LightSource, Limits, PlayedWaveform
from drivers.light.scpi_dialects import DIALECTS
from drivers.light.scpi_talk import ScpiTalk, number_of, port_at
from drivers.light.waveform_shapes import Constant, NoShape, SquareWave, shape_of
from protocols.errors import InputError

if TYPE_CHECKING:
    from drivers.interfaces import Clock, Waveform
    from drivers.light.scpi_dialects import Dialect, Load, Setting
    from drivers.transport.trace import Trace

__all__ = ["ScpiGenerator"]

_log = logging.getLogger("evs_bench.devices")

_UNITS: Final = {"V": 1.0, "mV": 1e-3}
_STEP_V: Final = 1e-3  #: all generators here can be set so finely
_SMALLEST_SWING_V: Final = 4e-3  #: 2 mV peak to peak into 50 ohm, the smallest amplitude of the coarsest of them
_PARKED_V: Final = 10e-3  #: by how much the upper level is at least above the lower one while nothing plays
_LEAD: Final = 1.0 / 360.0  #: part of a period before the first rise at which a burst starts that has to start low
_DARK_TRIES: Final = 3


class ScpiGenerator(LightSource):
    """An LED driven by the voltage of a function generator, which times square waves on its own clock.

    The level is the voltage at the load; the LED driver must take it for brightness, and 0 V for dark. The
    generator waits, armed, for the trigger of a burst, and the light is at the lower level of its square wave: see
    :mod:`drivers.light.scpi_dialects` for why, and for what the makers' dialects can and cannot do. Dark is the
    output switched off.

    It plays one level, and square waves that begin with the lower level. The trigger is given by the host, so the
    low level at the beginning may last a few milliseconds longer than asked for; from the first rise to the last
    fall the generator is the clock. Its sync output is switched on: its edges are those of the square wave. A
    waveform that ends with the upper level falls for some milliseconds after its end, before the level stays there.

    Parameters
    ----------
    address
        tcp://host:port (Rigol listens at port 5555, Siglent and Keysight at 5025), or the path of a file of the
        kernel's usbtmc driver, /dev/usbtmc0.
    dialect
        "rigol", "siglent" or "keysight".
    clock
        The clock by which it waits for the end of a waveform.
    lowest, highest
        Limits of the level; 0 (dark) is always allowed.
    unit
        Of the level, "V" or "mV".
    channel
        Output of the generator, from 1.
    load
        What the output is connected to: "high_z", or 50 (ohm). It is set and read back before the light goes on, as
        a wrong one halves or doubles the voltage.
    edge_time_s, settling_s
        10 % to 90 % of a step of the light, and from a step until the light is stable, s: that of the LED driver.
    timeout_s
        How long an answer may take, s of real time.
    name
        What the operator calls it.

    Raises
    ------
    InputError
        An argument is out of range.
    """

    def __init__(
        self,
        address: str,
        *,
        dialect: str,
        clock: Clock,
        lowest: float,
        highest: float,
        unit: str = "V",
        channel: int = 1,
        load: Load = "high_z",
        edge_time_s: float = 0.0,
        settling_s: float = 0.0,
        timeout_s: float = 2.0,
        name: str = "light source",
    ) -> None:
        super().__init__(name)
        _require(dialect in DIALECTS, f"{name}: dialect is {dialect!r}; expected {', '.join(DIALECTS)}")
        _require(unit in _UNITS, f"{name}: unit is {unit!r}; expected {', '.join(_UNITS)}")
        _require(type(channel) is int and 1 <= channel <= 4, f"{name}: channel is {channel!r}; expected 1 to 4")
        _require(load in ("high_z", 50), f"{name}: load is {load!r}; expected high_z or 50")
        limits = f"{name}: limits are {lowest} to {highest} {unit}; expected 0 < lowest < highest"
        _require(0.0 < lowest < highest < math.inf, limits)
        for what, value in (("edge_time_s", edge_time_s), ("settling_s", settling_s)):
            _require(0.0 <= value < math.inf, f"{name}: {what} is {value}; expected 0 s or more")
        _require(0.0 < timeout_s < math.inf, f"{name}: timeout_s is {timeout_s}; expected more than 0 s")
        self.timing = "device"
        self.limits = Limits(lowest, highest, unit)
        self.edge_time_s = edge_time_s
        self.settling_s = settling_s
        self._volts_per_unit = _UNITS[unit]
        self.level_step = _STEP_V / self._volts_per_unit
        self._clock = clock
        self._dialect: Dialect = DIALECTS[dialect](channel)
        self._load: Load = load
        self._talk = ScpiTalk(port_at(address, timeout_s), name, timeout_s)
        self._identity: dict[str, str] = {}
        self._burst_over_s = -math.inf  #: on the clock: the generator is not sooner ready for a trigger

    def trace_to(self, trace: Trace | None) -> None:
        """Write every byte that goes over the link into `trace` from now on; None: no more."""
        self._talk.trace_to(trace)

    def identity(self) -> dict[str, str]:
        """Return maker, model, serial number and firmware version, as the generator told them when it connected."""
        self.require_connected("identify itself")
        return dict(self._identity)

    def level(self) -> float:
        """Return the level between bursts as read back: 0 if the output is off."""
        self.require_connected("read the level")
        return self._low_v() / self._volts_per_unit if self._is_on() else 0.0

    def why_not(self, waveform: Waveform) -> str:
        """Return why the generator cannot time `waveform`; empty if it can."""
        shape = shape_of(waveform)
        if isinstance(shape, NoShape):
            return f"{shape.reason}; it can time a constant level, or a square wave between two"
        return "" if isinstance(shape, Constant) else self._why_not_square(shape)

    def _why_not_square(self, square: SquareWave) -> str:
        dialect, (lowest, highest) = self._dialect, self._dialect.duty
        swing_v = (square.high - square.low) * self._volts_per_unit
        if not lowest - 1e-9 <= square.duty <= highest + 1e-9:
            return f"its duty is {square.duty:.4g}; it can time {lowest:g} to {highest:g}"
        if square.cycles > dialect.most_cycles:
            return f"it has {square.cycles} cycles; it can time {dialect.most_cycles}"
        if square.period_s * dialect.highest_hz < 1.0:
            return f"its period is {square.period_s:.4g} s; it can time {1.0 / dialect.highest_hz:g} s and more"
        if swing_v < _SMALLEST_SWING_V - 1e-9:
            return f"its levels are {swing_v:.4g} V apart; it can time {_SMALLEST_SWING_V:g} V and more"
        return ""

    def _connect(self) -> None:
        maker, model, serial, firmware = self._talk.open()
        try:
            if not maker.lower().startswith(self._dialect.makers):
                expected = ", ".join(sorted(self._dialect.makers))
                raise ConnectionFailed(
                    self.name, "connect", f"this is {maker} {model}", f"the dialect is for {expected}; set another"
                )
            self._identity = {"maker": maker, "model": model, "serial": serial, "firmware": firmware}
            self._talk.tell("*CLS")
            self._prepare()
        except BaseException:
            self._talk.close()
            raise

    def _close(self) -> None:
        self._talk.close()

    def _prepare(self) -> None:
        """Let it wait for a burst, in the dark."""
        self._burst_over_s = -math.inf
        self._put(self._dialect.output(False))
        self._put(self._dialect.load(self._load))
        for setting in self._dialect.preparation():
            self._put(setting)
        for setting in self._dialect.square(10.0, 0.5, 1, self._phase_deg(0.1, 0.1 * _LEAD)):
            self._put(setting)
        self._go_to(0.0)

    def _safe_state(self) -> None:
        for left in reversed(range(_DARK_TRIES)):
            try:
                self._put(self._dialect.output(False))
            except DeviceError as error:
                if not left:
                    raise
                _log.warning("%s; not dark yet, trying again", error)
            else:
                return

    def _set_level(self, level: float) -> None:
        if level == 0.0:
            self._put(self._dialect.output(False))
        else:
            self._rest_at(level * self._volts_per_unit)

    def _play(self, waveform: Waveform) -> PlayedWaveform:
        shape = shape_of(waveform)
        t_s = waveform.t_s.copy()
        if isinstance(shape, NoShape):
            raise Unsupported(self.name, "play a waveform", shape.reason)
        if isinstance(shape, Constant):
            self._set_level(shape.level)
            self._clock.sleep(shape.duration_s)
            if shape.level != 0.0:
                self._require_still_on()
        else:
            duty = self._play_square(shape)
            falls = np.concatenate([[False], np.diff(waveform.level) < 0.0])
            t_s[falls] += (duty - shape.duty) * shape.period_s
        return PlayedWaveform(t_s)

    def _play_square(self, square: SquareWave) -> float:
        """Play a square wave, and return the duty that it had."""
        lead_s = self._lead_s(square)
        self._rest_at(square.low * self._volts_per_unit)
        course = self._dialect.square(
            1.0 / square.period_s, square.duty, square.cycles, self._phase_deg(square.period_s, lead_s)
        )
        duty = [self._put(setting) for setting in course][1] / 100.0
        duty = square.duty if abs(duty - square.duty) < 1e-6 else duty
        self._put(self._dialect.high(square.high * self._volts_per_unit))
        self._wait_until(self._burst_over_s)
        self._clock.sleep(square.first_edge_s - lead_s)
        self._trigger(lead_s + square.last_fall_s - square.first_edge_s)
        rest_s = (1.0 - square.duty) * square.period_s - lead_s  # of the burst, after its last pulse
        self._burst_over_s = self._clock.now() + rest_s
        after_s = max(square.duration_s - square.last_fall_s, 0.0)
        self._clock.sleep(after_s)
        self._require_still_on()
        if square.ends_high:
            self._go_to(square.high * self._volts_per_unit)
        elif self._dialect.tells_end and after_s >= rest_s:
            self._require_end()
        return duty

    def _trigger(self, lasts_s: float) -> None:
        """Start the burst, and return when its last pulse is over, `lasts_s` later."""
        begin_s = self._clock.now()
        self._talk.tell(self._dialect.trigger)
        if self._clock.now() - begin_s < 0.999 * lasts_s:  # it answered at once: the burst has only begun
            self._clock.sleep(lasts_s)

    def _require_still_on(self) -> None:
        """Raise if the output went off meanwhile: a generator that restarts, and loses the trigger, says nothing."""
        if not self._is_on():
            raise DataLost(
                self.name,
                "play a waveform",
                "its output is off at the end",
                "did it restart? take the recording again",
            )

    def _require_end(self) -> None:
        """Ask whether the burst is over: it should be."""
        answer = self._talk.ask("*OPC?")
        if answer not in ("1", "+1"):
            raise UnexpectedAnswer(self.name, "wait for the end of a burst (*OPC?)", repr(answer), "try again")

    def _lead_s(self, square: SquareWave) -> float:
        """Return for how long the burst is at its lower level before the first rise."""
        if not self._dialect.starts_low:
            return 0.0
        low_s = (1.0 - square.duty) * square.period_s
        lead_s = min(_LEAD * square.period_s, 0.5 * low_s, 0.5 * square.first_edge_s)
        grid_s = 1e-6 if lead_s > 10e-6 else 1e-9
        return math.floor(lead_s / grid_s) * grid_s

    def _phase_deg(self, period_s: float, lead_s: float) -> float:
        return 360.0 * (1.0 - lead_s / period_s) if lead_s > 0.0 and self._dialect.starts_low else 0.0

    def _rest_at(self, volts: float) -> None:
        """Be lit at `volts`, armed; one that was switched off meanwhile has forgotten all, and is told again."""
        load = self._dialect.load(self._load)
        if self._differs(load, self._ask(load)):
            _log.warning("%s: it has another load than it was told; setting it up again", self.name)
            self._prepare()
        self._go_to(volts)
        if not self._is_on():
            self._put(self._dialect.output(True))

    def _go_to(self, volts: float) -> None:
        """Set the lower level, and the upper one above it: it is never the lower one of the two on the way."""
        highest_v = self.limits.highest * self._volts_per_unit
        low, high = self._dialect.low(volts), self._dialect.high(max(highest_v, volts + _PARKED_V))
        for setting in (high, low) if volts > self._low_v() else (low, high):
            self._put(setting)

    def _wait_until(self, time_s: float) -> None:
        left_s = time_s - self._clock.now()
        if left_s > 0.0:
            self._clock.sleep(left_s)

    def _is_on(self) -> bool:
        on, off = self._dialect.output(True), self._dialect.output(False)
        answer = self._ask(on)
        if self._differs(on, answer) and self._differs(off, answer):
            raise self._unexpected(on, answer)
        return not self._differs(on, answer)

    def _low_v(self) -> float:
        setting = self._dialect.low(0.0)
        return number_of(self.name, setting.question, self._ask(setting))

    def _put(self, setting: Setting) -> float:
        """Set something, read it back, and return it as it is; a word is 0."""
        self._talk.tell(setting.command)
        answer = self._ask(setting)
        if self._differs(setting, answer):
            raise self._unexpected(setting, answer)
        return number_of(self.name, setting.question, answer) if isinstance(setting.expected, float) else 0.0

    def _ask(self, setting: Setting) -> str:
        answer = self._talk.ask(setting.question)
        value = self._dialect.value(setting, answer)
        if value is None:
            raise UnexpectedAnswer(self.name, setting.question, repr(answer), "is the dialect right? try again")
        return value

    def _differs(self, setting: Setting, answer: str) -> bool:
        if isinstance(setting.expected, tuple):
            return answer.upper() not in setting.expected
        try:
            return not abs(float(answer) - setting.expected) <= setting.tolerance
        except ValueError:
            return True

    def _unexpected(self, setting: Setting, answer: str) -> UnexpectedAnswer:
        asked = f"set {setting.what} ({setting.command})"
        return UnexpectedAnswer(
            self.name, asked, f"it is {answer!r} {setting.unit}".rstrip(), "can the generator do this? try again"
        )


def _require(fulfilled: bool, message: str) -> None:
    if not fulfilled:
        raise InputError(message)
