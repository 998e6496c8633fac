"""The SpectralLED RS-7 of Gamma Scientific, over a serial port.

Source: Gamma Scientific, SpectralLED RS-7 User Manual, rev. A/X1 (2018), firmware 1.12. The unit has no trigger and
no waveforms: every edge is a command of the host, which is answered when the light has settled.
"""

from __future__ import annotations

import contextlib
import logging
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from drivers.errors import ConnectionFailed, DeviceError, DeviceTimeout, UnexpectedAnswer, WrongState
from drivers.interfaces import LightSource, Limits, PlayedWaveform
from drivers.light.level_player import Played, Schedule, StationTime, play_in_process, play_levels
from drivers.light.rs7_errors import Treatment, complaint_raised
from drivers.light.rs7_setup import Setup
from drivers.light.rs7_spectrum import FIRST_NM, LAST_NM, EmittedSpectrum, spectrum_in
from drivers.light.rs7_talk import Talk
from drivers.transport.link import Link
from drivers.transport.ports import SerialPort
from protocols.errors import InputError

if TYPE_CHECKING:
    from drivers.interfaces import Clock, Waveform
    from drivers.light.rs7_errors import Complaint
    from drivers.transport.trace import Trace

__all__ = ["SpectralLed"]

_log = logging.getLogger("evs_bench.devices")

_TRIES: Final = 3
_DARK_FRACTION: Final = 0.1  # of the lowest level: what the photodiode may still see of a light that is off
_READ_BACK_FRACTION: Final = 0.02  # nominal accuracy is 1 %
_UPTIME_TOLERANCE_S: Final = 2.0
_UPTIME_TOLERANCE: Final = 1e-3
_SPECTRUM_TIMEOUT_S: Final = 10.0
_PLAY: Final = "play a waveform"


class SpectralLed(LightSource):
    """An RS-7 whose overall level (`OUT`) is set and stepped.

    Edges are timed by the host. Of each one it is known when the command was written, when the unit acknowledged it
    (at once on receipt), and when it said that the light had settled; the light moves between the second and the
    third, and the acknowledgement is returned as the time of the edge. Over USB it may be read up to 16 ms late. What
    lies between it and the light is not documented: a photodiode at the camera's trigger input measures it.

    Off is `OUT 0`, which keeps the spectrum in the unit's memory. `SCP 0,0` would be as dark, but wipes the spectrum,
    after which every `OUT` is refused (?16) until a preset is loaded; it is not used, at :meth:`close` neither. After
    a power failure the unit is lit again, with its preset 0: store a dark preset 0 for unattended runs. The driver
    notices by the unit's uptime before and after each waveform and before each level, makes the light dark, and
    raises.

    Parameters
    ----------
    port
        Serial port (/dev/serial/by-id/...).
    clock
        The clock of the station.
    lowest, highest
        Limits of the level for this spectrum; 0 (dark) is always allowed.
    unit
        "cd/m2", "lux", "uW/cm2/sr", "uW/cm2" or "%": sets `UNI` of the unit and must fit its calibration type.
    spectrum
        Number or name of the preset to load at :meth:`connect`, which lights the unit for a moment; None for the
        spectrum that is in it.
    working_distance_mm
        From the port of the sphere to where irradiance and illuminance are meant (`IRR`), mm.
    settle_percent
        How near to its target the light is settled (`STP`); None for the setting of the unit.
    feedback
        Whether the unit trims the light by its photodiode (`FBK`). Without, it drifts as the LEDs warm up.
    attenuator
        "refuse" to connect, or "recorded" in :meth:`identity`, if an attenuating filter is declared in the unit
        (`ATF`): its levels then include that filter, and one in a filter wheel would be counted twice.
    player
        "process": waveforms are played by a process of their own, in real time (POSIX only). "inline": by the thread
        that calls, on `clock`; for a clock that is not the real one.
    timeout_s
        For one answer, s of real time. The unit itself gives up settling after 0.5 s.
    baud
        Bits per second: 460800 as delivered, or 115200.
    edge_time_s
        10 % to 90 % of a step, s. The manual does not say: measure it.
    settling_s
        From a step until the light is stable, s.
    name
        What the operator calls it.

    Raises
    ------
    InputError
        An argument is none of those that are allowed.
    """

    timing = "host"
    level_is_measured = True  # by the photodiode of the unit

    def __init__(
        self,
        port: str,
        *,
        clock: Clock,
        lowest: float = 20.0,
        highest: float = 15000.0,
        unit: str = "cd/m2",
        spectrum: str | int | None = None,
        working_distance_mm: float | None = None,
        settle_percent: float | None = None,
        feedback: bool = True,
        attenuator: Literal["refuse", "recorded"] = "refuse",
        player: Literal["process", "inline"] = "process",
        timeout_s: float = 2.0,
        baud: int = 460800,
        edge_time_s: float = 1e-3,
        settling_s: float = 0.05,
        name: str = "light source",
    ) -> None:
        super().__init__(name)
        if player not in ("process", "inline"):
            raise InputError(f"{name}: player is {player!r}; expected process or inline")
        if not 0.0 < lowest < highest < float("inf"):
            raise InputError(f"{name}: limits are {lowest} to {highest} {unit}; expected 0 < lowest < highest")
        if not 0.0 < timeout_s < float("inf"):
            raise InputError(f"{name}: timeout_s is {timeout_s}; expected more than 0 s")
        self.limits = Limits(lowest, highest, unit)
        self.edge_time_s = edge_time_s
        self.settling_s = settling_s
        self._clock = clock
        self._in_process = player == "process"
        self._port = SerialPort(port, baud)
        self._talk = Talk(Link(self._port, name, timeout_s), name, clock)
        self._setup = Setup(unit, spectrum, working_distance_mm, settle_percent, feedback, attenuator)
        self._identity: dict[str, str] = {}
        self._uptime: tuple[float, float] | None = None  # of the unit, and when it was that by our clock, s
        self._power_failed = False
        self._at: float | None = None  # the level that was reached; None if it is not known

    @property
    def alarms(self) -> tuple[Complaint, ...]:
        """All alarms that the unit raised since connect(), oldest first."""
        return tuple(self._talk.alarms)

    def identity(self) -> dict[str, str]:
        """Return maker, model, serial number and firmware version, calibration, and the declared attenuator."""
        self.require_connected("identify itself")
        return dict(self._identity)

    def level(self) -> float:
        """Return the level as the unit's photodiode measures it (`OUTA`); 0 if it is off and measures no light.

        Raises
        ------
        DeviceError
            It is off and the photodiode sees light.
        """
        self.require_connected("read the level")
        nominal, measured = self._talk.number("OUT"), self._talk.number("OUTA")
        if nominal != 0.0:
            return measured
        self._require_dark(measured)
        return 0.0

    def spectrum(self) -> EmittedSpectrum:
        """Return the spectrum that the unit says it emits now (`OSP`)."""
        self.require_connected("read the spectrum")
        self._talk.do(f"WLR {FIRST_NM},{LAST_NM}")
        self._talk.do("STM 1")
        rows = self._talk.rows("OSP", timeout_s=_SPECTRUM_TIMEOUT_S)
        return spectrum_in(self.name, rows, self._setup.spectral_unit)

    def trace_to(self, trace: Trace | None) -> None:
        """Write every byte that goes over the link into `trace` from now on; None: no more."""
        self._talk.link.trace = trace

    def _connect(self) -> None:
        talk = self._talk
        talk.alarms.clear()
        self._uptime, self._power_failed, self._at = None, False, None
        talk.link.open()
        try:
            talk.do("ASA 0")  # no alarms in between from now on: they are asked for
            self._darken()
            self._identity = self._setup.identify(talk)
            talk.serial = self._identity["serial"]
            self._uptime = (talk.uptime_s(), self._clock.now())
            self._setup.apply(talk)
            talk.do("ALAC")
        except BaseException:
            with contextlib.suppress(DeviceError):
                self._darken()
            talk.link.close()
            raise

    def _close(self) -> None:
        self._talk.link.close()

    def _safe_state(self) -> None:
        problem: DeviceError | None = None
        for _ in range(_TRIES):
            try:
                if isinstance(problem, ConnectionFailed):
                    self._talk.reopen()
                self._darken()
            except DeviceError as error:
                problem = error
            else:
                return
        if problem is not None:
            raise problem

    def _darken(self) -> None:
        """Make the light dark, and see that it is."""
        self._at = None
        answer = self._talk.ask("OUT 0", "ok")
        if answer.complaint is not None and answer.complaint.code != "16":  # no spectrum: there is nothing to be lit
            raise complaint_raised(self.name, "OUT 0", answer.complaint)
        nominal, measured = self._talk.number("OUT"), self._talk.number("OUTA")
        if nominal != 0.0:
            raise UnexpectedAnswer(self.name, "OUT 0", f"the level is {nominal:g} {self.limits.unit} all the same")
        self._require_dark(measured)
        self._at = 0.0

    def _require_dark(self, measured: float) -> None:
        if abs(measured) > _DARK_FRACTION * self.limits.lowest:
            raise DeviceError(
                self.name,
                "be dark",
                f"it is off, and its photodiode measures {measured:g} {self.limits.unit}",
                "does light of the room fall into the sphere?",
            )

    def _set_level(self, level: float) -> None:
        asked = f"set level to {level:g} {self.limits.unit}"
        self._look(asked)
        try:
            self._talk.step_to(level)
        except WrongState:
            raise  # the unit refused it: the light is what it was
        except DeviceError as error:
            self._at = None
            if not isinstance(error, DeviceTimeout | UnexpectedAnswer) or not self._is_at(level):
                self._go_dark(asked)
                raise
            _log.warning("%s; but the level is read back as asked for", error)
        self._at = level

    def _is_at(self, level: float) -> bool:
        """Return whether the unit reads back `level` after all, without having been off in between."""
        try:
            self._look("read back the level")
            nominal, measured = self._talk.number("OUT"), self._talk.number("OUTA")
        except DeviceError:
            return False
        tolerance = _READ_BACK_FRACTION * level + _DARK_FRACTION * self.limits.lowest * (level == 0.0)
        return abs(nominal - level) <= 1e-3 * level and abs(measured - level) <= tolerance

    def _go_dark(self, asked: str) -> None:
        """Make the light dark after an error, which matters more than one more of them."""
        try:
            self._safe_state()
        except DeviceError as error:
            _log.error("%s: %s failed, and the light could not be made dark: %s", self.name, asked, error)

    def _play(self, waveform: Waveform) -> PlayedWaveform:
        t_s, level = waveform.t_s, waveform.level
        if len(t_s) == 0 or len(t_s) != len(level) or t_s[0] != 0.0 or np.any(np.diff(t_s) < 0.0):
            raise WrongState(self.name, _PLAY, "its times do not ascend from 0 s", "correct the waveform")
        if not waveform.duration_s >= t_s[-1]:
            raise WrongState(self.name, _PLAY, f"of {waveform.duration_s} s with an edge after its end", "correct it")
        self._look(_PLAY)
        schedule = Schedule(
            tuple(t_s.tolist()), tuple(level.tolist()), waveform.duration_s, self._at, self._talk.link.timeout_s
        )
        try:
            played = self._played(schedule)
            self._look(_PLAY)
        except BaseException:
            self._talk.lost_step()
            self._go_dark(_PLAY)
            raise
        self._at = float(level[-1])
        times = np.array([(step.written_s, step.acknowledged_s, step.settled_s) for step in played.steps])
        written, acknowledged, settled = times.T.copy()
        return PlayedWaveform(acknowledged.copy(), written, acknowledged, settled)

    def _played(self, schedule: Schedule) -> Played:
        self._at = None
        if not self._in_process:
            played = play_levels(self._talk.link, self.name, schedule, StationTime(self._clock))
        else:
            with self._talk.link.exchange(_PLAY):
                played = play_in_process(self._port.fd, self.name, schedule)
            self._trace_played(played)
        for step in played.steps:
            self._talk.note(step.alarms)
        return played

    def _trace_played(self, played: Played) -> None:
        """Write into the trace what the other process sent and received, with its own times."""
        trace = self._talk.link.trace
        if trace is not None and played.traffic:
            begin_s = played.traffic[0][0]
            for time_s, what, data in played.traffic:
                note = f"player {time_s - begin_s:+.6f} s {what} ".encode() + data.encode("latin-1")
                trace.add(self.name, "noted", note)

    def _look(self, asked: str) -> None:
        """See that the unit was on since the last look, and raised no alarm that ends the run.

        Raises
        ------
        DeviceError
            It was not, or did; the light is dark.
        """
        uptime_s, now_s = self._talk.uptime_s(), self._clock.now()
        if self._uptime is not None:
            was_s, then_s = self._uptime
            expected_s = was_s + (now_s - then_s) * (1.0 - _UPTIME_TOLERANCE) - _UPTIME_TOLERANCE_S
            self._power_failed |= uptime_s < max(was_s, expected_s)
        if self._power_failed:  # and so it stays: the unit has lost what connect() set
            self._go_dark(asked)
            why = f"the power failed: it has been on for {uptime_s:g} s only"
            raise DeviceError(self.name, asked, why, "see to the supply, and connect to it again")
        self._uptime = (uptime_s, now_s)
        self._look_for_alarms(asked)

    def _look_for_alarms(self, asked: str) -> None:
        seen = len(self._talk.alarms)
        rows = self._talk.rows("ALA", "loose list")
        if rows:
            _log.warning("%s: alarms: %s", self.name, ", ".join(rows))
        new = self._talk.alarms[seen:]
        if new:
            self._talk.do("ALAC")
        stop = next((alarm for alarm in new if alarm.treatment is Treatment.STOP), None)
        if stop is not None:
            self._go_dark(asked)
            raise complaint_raised(self.name, asked, stop)
