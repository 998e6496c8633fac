"""Effects that no built-in one can express: the diagnosis has never heard of them.

They need the hooks of :class:`~sim_backend.pixel.effects.base.Effect`, so the reference engine makes their events.
None of them was seen in a sensor; each is a thing that a sensor might do. The file can be named with ``--effects``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np

from sim_backend.pixel.effects import Effect, Stage
from sim_backend.pixel.parameters import parameter

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel.engines.readout import EventDraws

    Floats = npt.NDArray[np.float64]

_US_PER_S: Final = 1e6
_REFERENCE_LUX: Final = 3.0


@dataclass(frozen=True, slots=True)
class LightDeadTime(Effect):
    """The dead time follows the light: ``period (1 + half_fa / I)``."""

    id: ClassVar[str] = "light_dead_time"
    stage: ClassVar[Stage] = "refractory"
    sign: ClassVar[str] = "The second event of a large step vanishes as the light falls, the first stays."

    half_fa: float = parameter("fA", (0.0, 1e6), 10.0, 0.0, "photocurrent at which the dead time is twice as long")

    def refractory(self, period_s: float, current_fa: float, z: float) -> float:  # noqa: ARG002
        """Return the dead time."""
        return period_s * (1.0 + self.half_fa / current_fa)


@dataclass(frozen=True, slots=True)
class TelegraphThresholds(Effect):
    """Random telegraph: after each reset both thresholds are ``1 + depth`` or ``1 - depth`` times their own."""

    id: ClassVar[str] = "telegraph_thresholds"
    stage: ClassVar[Stage] = "comparators"
    sign: ClassVar[str] = "Response curves have two steps, in every pixel and at every light."

    depth: float = parameter("1", (0.0, 0.9), 0.15, 0.0, "relative change of the thresholds")

    def thresholds(
        self, on: float, off: float, current_fa: float, since_s: float, z: float  # noqa: ARG002
    ) -> tuple[float, float]:  # fmt: skip
        """Return the thresholds."""
        factor = 1.0 + self.depth if z > 0.0 else 1.0 - self.depth
        return on * factor, off * factor


@dataclass(frozen=True, slots=True)
class Rebound(Effect):
    """An overshoot: with this probability an event is followed by one of the other polarity, 4 ms later."""

    id: ClassVar[str] = "rebound"
    stage: ClassVar[Stage] = "readout"
    sign: ClassVar[str] = "Events of the wrong polarity shortly after the right ones, always as late."

    probability: float = parameter("1", (0.0, 1.0), 0.03, 0.0, "that an event has a follower")

    def events(
        self, events: npt.NDArray[np.void], draws: EventDraws, memory: dict[str, Any]  # noqa: ARG002
    ) -> npt.NDArray[np.void]:  # fmt: skip
        """Return the events and their followers."""
        followers = events[draws.uniform(events, "rebound.follows") < self.probability].copy()
        followers["t_us"] += 0.004 * _US_PER_S
        followers["p"] = 1 - followers["p"]
        both = np.concatenate([events, followers])
        return both[np.argsort(both["t_us"], kind="stable")]


@dataclass(frozen=True, slots=True)
class GainDrift(Effect):
    """The response to light grows with time: the step of ln E by c is one by ``c (1 + rate t)``."""

    id: ClassVar[str] = "gain_drift"
    stage: ClassVar[Stage] = "light"
    sign: ClassVar[str] = "Later pulses of a recording are answered more than earlier ones, as if thresholds drifted."

    rate_per_s: float = parameter("1/s", (0.0, 1.0), 0.05, 0.0, "relative growth per second")

    def light(self, lux: Floats, t_s: Floats) -> Floats:
        """Return the light of an ideal pixel that does the same."""
        relative = np.maximum(lux, 1e-12) / _REFERENCE_LUX
        return np.asarray(_REFERENCE_LUX * relative ** (1.0 + self.rate_per_s * t_s))


@dataclass(frozen=True, slots=True)
class BrightNoise(Effect):
    """The noise grows with the light: ``rms sqrt(1 + gain I / 1 pA)``."""

    id: ClassVar[str] = "bright_noise"
    stage: ClassVar[Stage] = "source follower"
    sign: ClassVar[str] = "Noise events and broad curves at high light, none at low light."

    gain: float = parameter("1", (0.0, 100.0), 0.5, 0.0, "growth of the variance at 1 pA")

    def noise_rms(self, rms: float, current_fa: float) -> float:
        """Return the rms."""
        return float(rms * np.sqrt(1.0 + self.gain * current_fa / 1000.0))


@dataclass(frozen=True, slots=True)
class Compression(Effect):
    """Bright light is compressed: ``u = ln(I / (1 + share I / 1 pA))``."""

    id: ClassVar[str] = "compression"
    stage: ClassVar[Stage] = "photoreceptor"
    sign: ClassVar[str] = "The response curve moves to higher contrast as the light rises."

    share: float = parameter("1", (0.0, 100.0), 0.1, 0.0, "loss of current at 1 pA, relative")

    def response(self, u: float, current_fa: float) -> float:
        """Return the response."""
        return float(u - np.log1p(self.share * current_fa / 1000.0))


@dataclass(frozen=True, slots=True)
class PolarityError(Effect):
    """Each event is sent with the other polarity with this probability."""

    id: ClassVar[str] = "polarity_error"
    stage: ClassVar[Stage] = "readout"
    sign: ClassVar[str] = "Events of the wrong polarity at the time of the right ones."

    probability: float = parameter("1", (0.0, 1.0), 0.03, 0.0, "that an event is sent wrongly")

    def events(
        self, events: npt.NDArray[np.void], draws: EventDraws, memory: dict[str, Any]  # noqa: ARG002
    ) -> npt.NDArray[np.void]:  # fmt: skip
        """Return the events."""
        changed = events.copy()
        wrong = draws.uniform(events, "polarity_error.wrong") < self.probability
        changed["p"] = np.where(wrong, 1 - changed["p"], changed["p"])
        return changed


@dataclass(frozen=True, slots=True)
class DeadFrames(Effect):
    """In each 33 ms the readout loses all events of the first part."""

    id: ClassVar[str] = "dead_frames"
    stage: ClassVar[Stage] = "readout"
    sign: ClassVar[str] = "Responses fail in whole pulses, in all pixels at once, at a phase that is not the pulses'."

    share: float = parameter("1", (0.0, 0.9), 0.05, 0.0, "of the time that is lost")

    def events(
        self, events: npt.NDArray[np.void], draws: EventDraws, memory: dict[str, Any]  # noqa: ARG002
    ) -> npt.NDArray[np.void]:  # fmt: skip
        """Return the events."""
        return events[(events["t_us"] / (0.033 * _US_PER_S)) % 1.0 >= self.share]


STRANGE: Final[tuple[type[Effect], ...]] = (
    LightDeadTime,
    TelegraphThresholds,
    Rebound,
    GainDrift,
    BrightNoise,
    Compression,
    PolarityError,
    DeadFrames,
)
