"""What chance leaves of the true model of a case: the error of a fit that is told everything, and begins there.

Of a model that lacks nothing the error is 1, give or take the chance in one recording: some 7 % in the small runs of
the study. Where a diagnosis ends higher, this tells whether it could have done better.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from bench.diagnosis.fitting.judging import deviance_per_dof
from bench.diagnosis.session import open_session
from bench.store import Run

if TYPE_CHECKING:
    from pathlib import Path

    from sim_backend.pixel import PixelModel

__all__ = ["floor_of"]

_SEED: Final = 1


def floor_of(run: Path, model: PixelModel) -> float:
    """Return the error that the true model leaves, by degree of freedom, fitted to a run from the truth on.

    Parameters
    ----------
    run
        Folder of the run.
    model
        The truth.
    """
    with open_session([Run.open(run)], model) as session:
        fitted = session.sharpened(session.fit(_SEED), _SEED + 31)
        return deviance_per_dof(session.problem, fitted)
