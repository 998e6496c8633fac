"""The seam of a physical effect."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Final, Literal, Self

from sim_backend.pixel.hooks import HOOKS
from sim_backend.pixel.parameters import Described

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from sim_backend.pixel.chain import Chain, PixelDraws
    from sim_backend.pixel.engines.readout import EventDraws

__all__ = ["STAGES", "Effect", "Stage"]

Stage = Literal[
    "light",
    "photocurrent",
    "photoreceptor",
    "source follower",
    "change detector",
    "comparators",
    "refractory",
    "readout",
]

#: The stages in the order in which a signal passes them.
STAGES: Final[tuple[Stage, ...]] = (
    "light",
    "photocurrent",
    "photoreceptor",
    "source follower",
    "change detector",
    "comparators",
    "refractory",
    "readout",
)


class Effect(Described):
    """One physical effect: a frozen dataclass of parameters, and the way in which it changes a chain.

    A subclass is decorated with ``@dataclass(frozen=True, slots=True)``, sets `id`, `stage` and `sign`, makes each
    field with :func:`~sim_backend.pixel.parameters.parameter`, gives the equation and its source in its docstring,
    and implements :meth:`apply`, which changes numbers of the chain. It knows no engine.

    What numbers cannot say is said by a hook: a method that an engine calls at its stage of the chain. There is one
    for each stage; here they return what they are given, a subclass overrides those that it needs. The first argument
    is always what the stages before have made of it, and several effects act one after the other. Those for a pixel
    (:data:`~sim_backend.pixel.hooks.COMPILED`) take and return plain numbers, and are compiled: they may use the
    parameters of the effect as ``self.name`` (nan where one is left open), functions and constants of their file,
    ``math`` and ``numpy``.
    """

    __slots__ = ()

    id: ClassVar[str]  #: the name in files
    stage: ClassVar[Stage]  #: where in the chain it acts
    sign: ClassVar[str] = ""  #: one line on what it does to what can be measured
    #: What it does depends on how much light there is, not only on how much the light changes. False only saves time:
    #: points that differ by a factor of the light are then simulated once.
    knows_light: ClassVar[bool] = True

    def __post_init__(self) -> None:
        self.check_bounds(f"effect {self.id}")

    @classmethod
    def null(cls) -> Self:
        """Return the effect with each parameter at its null value (its default where it has none)."""
        return cls(**{p.name: p.default if p.null is None else p.null for p in cls.parameters()})

    @classmethod
    def hooks(cls) -> tuple[str, ...]:
        """Return the names of the hooks that this effect has."""
        return tuple(name for name in HOOKS if getattr(cls, name) is not getattr(Effect, name))

    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:
        """Return the chain with this effect in it; as it is, where hooks say all.

        Parameters
        ----------
        chain
            All earlier stages are in place.
        draws
            Frozen random numbers for each pixel; name the purpose ``"<id>.<what>"``.
        """
        del draws
        return chain

    def light(self, lux: npt.NDArray[np.float64], t_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the illuminance on the chip, (n,) lux, at the times `t_s`, (n,) s since the start of the recording.

        It is called stretch by stretch: what it returns for a sample must depend on that sample alone.
        """
        del t_s
        return lux

    def response(self, u: float, current_fa: float) -> float:
        """Return what the photoreceptor makes of the photocurrent `current_fa`, ln units; `u` is its logarithm."""
        del current_fa
        return u

    def receptor_hz(self, corner_hz: float, current_fa: float) -> float:
        """Return the corner of the photoreceptor's low-pass, Hz; infinite: none."""
        del current_fa
        return corner_hz

    def noise_rms(self, rms: float, current_fa: float) -> float:
        """Return the rms of the white noise behind the source follower, ln units.

        It is the stationary one; where the light steps, the rms follows with the time constant of the low-pass.
        """
        del current_fa
        return rms

    def leak(self, rate_per_s: float, current_fa: float) -> float:
        """Return the drift of D towards ON, ln units per s, without what goes in proportion to the light."""
        del current_fa
        return rate_per_s

    def thresholds(self, on: float, off: float, current_fa: float, since_s: float, z: float) -> tuple[float, float]:
        """Return the thresholds of both comparators, ln units, each above 0; looked at in every sample.

        Parameters
        ----------
        on, off
            Those of the pixel.
        current_fa
            Photocurrent, fA.
        since_s
            Time since the reset, s.
        z
            Standard normal number, another after each reset.
        """
        del current_fa, since_s, z
        return on, off

    def refractory(self, period_s: float, current_fa: float, z: float) -> float:
        """Return the dead time that follows an event, s; `z` is a standard normal number, another for each event."""
        del current_fa, z
        return period_s

    def events(self, events: npt.NDArray[np.void], draws: EventDraws, memory: dict[str, Any]) -> npt.NDArray[np.void]:
        """Return what the readout makes of events, behind all else that happens to them there.

        Parameters
        ----------
        events
            (n,) with the fields `t_us` (float64, us), `x`, `y`, `p` (1 ON, 0 OFF), in order of time: the next of the
            recording. Events may be left out, changed, added; none may go to an earlier time than the first of these.
        draws
            Random numbers of each event.
        memory
            Empty at the start of a recording, and the same from call to call: what is to be remembered of events.
            How many events come in one call must not matter.
        """
        del draws, memory
        return events
