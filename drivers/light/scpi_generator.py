"""A function generator that speaks SCPI, with an LED behind it: it times square waves and samples by itself."""

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING, Final

import numpy as np

from drivers.errors import ConnectionFailed, DataLost, DeviceError, UnexpectedAnswer, Unsupported
from drivers.interfaces import LightSource, Limits, PlayedWaveform
from drivers.light.scpi_dialects import DIALECTS
from drivers.light.scpi_plan import LEAD, Planner, lead_s_of, phase_deg_of
from drivers.light.scpi_samples import codes_of
from drivers.light.scpi_settings import Settings
from drivers.light.scpi_talk import ScpiTalk, number_of, port_at
from drivers.light.scpi_uploads import upload_for
from drivers.light.waveform_shapes import Constant, NoShape, SquareWave
from protocols.errors import InputError

if TYPE_CHECKING:
    from drivers.interfaces import Clock, Waveform
    from drivers.light.scpi_dialects import Dialect, Load, Setting
    from drivers.light.scpi_samples import Samples
    from drivers.transport.trace import Trace

__all__ = ["ScpiGenerator"]

_log = logging.getLogger("evs_bench.devices")

_UNITS: Final = {"V": 1.0, "mV": 1e-3}
_STEP_V: Final = 1e-3  #: all generators here can be set so finely
_PARKED_V: Final = 10e-3  #: by how much the upper level is at least above the lower one while nothing plays
_DARK_TRIES: Final = 3
_LATE_S: Final = 1e-6  #: by so little a trigger is not late
#: What the output does between bursts hangs on these: they are told first when it is lit.
_BETWEEN: Final = ("level between bursts", "start phase")


class ScpiGenerator(LightSource):
    """An LED driven by the voltage of a function generator, which times waveforms on its own clock.

    The level is the voltage at the load; the LED driver must take it for brightness, and 0 V for dark. The
    generator waits, armed, for the trigger of a burst, and the light is at the lower level of its square wave: see
    :mod:`drivers.light.scpi_dialects` for why, and for what the makers' dialects can and cannot do. Dark is the
    output switched off.

    It plays one level, square waves that begin with the lower level, and, as samples, any waveform that ends at the
    level of its beginning and has its edges on a raster: see :mod:`drivers.light.scpi_uploads` for how many. A level
    between the lowest and the highest one is then the nearest that the converter has; a step that differs by more
    than 1 % from the one asked for is refused.

    The trigger is given by the host, so the level at the beginning may last longer than asked for, by some
    milliseconds for a square wave and by the time of the upload for samples; what is returned has it. From the first
    edge to the last one the generator is the clock. While samples are made ready the light may be up to 10 mV beside
    the first level, and elsewhere between the lowest and the highest one for a moment if the first is neither.

    Its sync output is switched on. By the manuals it rises when a burst begins and falls when it is over, whatever
    the waveform: one trigger a recording, and none at the edges. The burst begins before the first edge, by up to a
    360th of a period for a square wave; for samples see `lead_s` in :class:`~drivers.light.scpi_samples.Samples`.
    A square wave that ends with the upper level falls for a while after its end, before the level stays there.

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
        self._settings = Settings(self._talk, self._dialect, name)
        self._upload = upload_for(self._dialect)
        self._planner = Planner(self._dialect, self._upload.memory, self._volts_per_unit)
        self._rest: float | None = None  #: of samples, between the lower and the upper level; None: a square wave
        self._identity: dict[str, str] = {}
        self._burst_s = (0.0, 0.0)  #: on the clock: begin and end of the last burst
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
        return self._rest_v() / self._volts_per_unit if self._is_on() else 0.0

    def why_not(self, waveform: Waveform) -> str:
        """Return why the generator cannot time `waveform`; empty if it can."""
        plan = self._planner.plan(waveform)
        return plan.reason if isinstance(plan, NoShape) else ""

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
        self._burst_over_s, self._rest = -math.inf, None
        self._put(self._dialect.output(False))
        self._put(self._dialect.load(self._load))
        for setting in (*self._dialect.preparation(), *self._idle_square()):
            self._put(setting)
        self._go_to(0.0)

    def _idle_square(self) -> tuple[Setting, ...]:
        return self._dialect.square(10.0, 0.5, 1, phase_deg_of(0.1, 0.1 * LEAD, self._dialect))

    def _back_to_square(self) -> None:
        """Let it wait for a square wave again after samples: from their first level to their lowest one."""
        settings = (*self._dialect.preparation(), *self._idle_square())
        for setting in sorted(settings, key=lambda s: s.what not in _BETWEEN):
            self._settings.see_to(setting)
        self._rest = None

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
        plan, begin_s = self._planner.plan(waveform), self._clock.now()
        if isinstance(plan, NoShape):
            raise Unsupported(self.name, "play a waveform", plan.reason)
        t_s = waveform.t_s.copy()
        if isinstance(plan, Constant):
            self._play_constant(plan)
        elif isinstance(plan, SquareWave):
            duty, late_s = self._play_square(plan, begin_s)
            falls = np.concatenate([[False], np.diff(waveform.level) < 0.0])
            t_s[falls] += (duty - plan.duty) * plan.period_s
            t_s[1:] += late_s
        else:
            late_s = self._play_samples(plan, begin_s)
            t_s[np.concatenate([[True], np.diff(waveform.level) != 0.0])] = plan.t_s
            t_s[1:] += late_s
        burst_s = None if isinstance(plan, Constant) else np.array(self._burst_s) - begin_s
        return PlayedWaveform(t_s, trigger_t_s=burst_s)

    def _play_constant(self, constant: Constant) -> None:
        self._set_level(constant.level)
        self._clock.sleep(constant.duration_s)
        if constant.level != 0.0:
            self._require_still_on()

    def _play_square(self, square: SquareWave, begin_s: float) -> tuple[float, float]:
        """Play a square wave; return the duty that it had, and how late its first edge came, s."""
        lead_s = lead_s_of(square, self._dialect)
        self._rest_at(square.low * self._volts_per_unit)
        course = self._dialect.square(
            1.0 / square.period_s, square.duty, square.cycles, phase_deg_of(square.period_s, lead_s, self._dialect)
        )
        duty = [self._put(setting) for setting in course][1] / 100.0
        duty = square.duty if abs(duty - square.duty) < 1e-6 else duty
        self._put(self._dialect.high(square.high * self._volts_per_unit))
        over_s, late_s = self._burst(begin_s, square.first_edge_s - lead_s, square.cycles * square.period_s)
        end_s = over_s - square.cycles * square.period_s + lead_s + square.duration_s - square.first_edge_s
        if square.ends_high:
            self._wait_until(end_s)
            self._require_still_on()
            self._go_to(square.high * self._volts_per_unit)
        else:
            self._finish(end_s, over_s)
        return duty, late_s

    def _play_samples(self, samples: Samples, begin_s: float) -> float:
        """Play samples, and return how late their first edge came, s."""
        base_v = float(samples.level[0]) * self._volts_per_unit
        self._rest_at(base_v)
        self._put(self._dialect.high(base_v + _PARKED_V))
        self._send(samples)
        self._rest = samples.rest
        for setting in self._upload.playing(samples):
            self._settings.see_to(setting)
        self._put(self._dialect.low(samples.lowest * self._volts_per_unit))
        self._put(self._dialect.high(samples.highest * self._volts_per_unit))
        first_s = float(samples.t_s[1])
        over_s, late_s = self._burst(begin_s, first_s - samples.lead_s, samples.cycles * samples.period_s)
        begun_s = over_s - samples.cycles * samples.period_s
        self._finish(begun_s + samples.lead_s + samples.duration_s - first_s, over_s)
        return late_s

    def _send(self, samples: Samples) -> None:
        """Send samples, and see that all of them have come."""
        code = codes_of(samples, self._upload.memory)
        if isinstance(code, NoShape):
            raise Unsupported(self.name, "play a waveform", code.reason)
        for setting in self._upload.before():
            self._settings.see_to(setting)
        for what, data in self._upload.blocks(code):
            self._talk.tell(what, data)
        stored = self._upload.stored(len(code))
        if not self._upload.reads_back:
            self._put(stored)
            return
        sent = self._upload.blocks(code)[-1][1][-2 * len(code) :]
        if self._talk.ask_block(stored.question, b"WAVEDATA,", len(sent)) != sent:
            raise UnexpectedAnswer(
                self.name, f"{stored.question} of {len(code)} samples", "others than were sent", "try again"
            )

    def _burst(self, begin_s: float, wait_s: float, lasts_s: float) -> tuple[float, float]:
        """Start the burst `wait_s` from now; return when it is over, and how late it came for `begin_s`, s."""
        self._wait_until(self._burst_over_s)
        self._clock.sleep(wait_s)
        begun_s = self._clock.now()
        late_s = begun_s - begin_s - wait_s
        self._talk.tell(self._dialect.trigger)
        self._burst_over_s = begun_s + lasts_s
        self._burst_s = begun_s, self._burst_over_s
        return self._burst_over_s, late_s if late_s > _LATE_S else 0.0

    def _finish(self, end_s: float, over_s: float) -> None:
        """Wait for the end of a waveform, and see that it came to it."""
        self._wait_until(end_s)
        self._require_still_on()
        if self._dialect.tells_end and end_s >= over_s:
            self._require_end()

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

    def _rest_at(self, volts: float) -> None:
        """Be lit at `volts`, armed; one that was switched off meanwhile has forgotten all, and is told again."""
        load = self._dialect.load(self._load)
        if self._settings.differs(load, self._settings.ask(load)):
            _log.warning("%s: it has another load than it was told; setting it up again", self.name)
            self._prepare()
        elif self._rest is not None:
            self._back_to_square()
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
        answer = self._settings.ask(on)
        if self._settings.differs(on, answer) and self._settings.differs(off, answer):
            raise self._settings.unexpected(on, answer)
        return not self._settings.differs(on, answer)

    def _low_v(self) -> float:
        return self._number(self._dialect.low(0.0))

    def _rest_v(self) -> float:
        """Return the voltage between bursts."""
        low_v = self._low_v()
        if not self._rest:
            return low_v
        return low_v + self._rest * (self._number(self._dialect.high(0.0)) - low_v)

    def _number(self, setting: Setting) -> float:
        return number_of(self.name, setting.question, self._settings.ask(setting))

    def _put(self, setting: Setting) -> float:
        return self._settings.put(setting)


def _require(fulfilled: bool, message: str) -> None:
    if not fulfilled:
        raise InputError(message)
