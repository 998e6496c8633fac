"""The seam of a physical effect."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar, Final, Literal, Self

from sim_backend.pixel.parameters import Described

if TYPE_CHECKING:
    from sim_backend.pixel.chain import Chain, PixelDraws

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


class Effect(Described, ABC):
    """One physical effect: a frozen dataclass of parameters, and the way in which it changes a chain.

    A subclass is decorated with ``@dataclass(frozen=True, slots=True)``, sets `id`, `stage` and `sign`, makes each
    field with :func:`~sim_backend.pixel.parameters.parameter`, gives the equation and its source in its docstring,
    and implements :meth:`apply`. It knows no engine: it changes numbers of the chain and no more.
    """

    __slots__ = ()

    id: ClassVar[str]  #: the name in files
    stage: ClassVar[Stage]  #: where in the chain it acts
    sign: ClassVar[str] = ""  #: one line on what it does to what can be measured

    def __post_init__(self) -> None:
        self.check_bounds(f"effect {self.id}")

    @classmethod
    def null(cls) -> Self:
        """Return the effect with each parameter at its null value (its default where it has none)."""
        return cls(**{p.name: p.default if p.null is None else p.null for p in cls.parameters()})

    @abstractmethod
    def apply(self, chain: Chain, draws: PixelDraws) -> Chain:
        """Return the chain with this effect in it.

        Parameters
        ----------
        chain
            All earlier stages are in place.
        draws
            Frozen random numbers for each pixel; name the purpose ``"<id>.<what>"``.
        """
