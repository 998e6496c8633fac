"""The numbers of a model follow a truth from place to place: one straight line does not lead far."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from benchmarks.planted.following import Place, changes_by, least_left, left_along
from sim_backend.pixel import PixelModel
from sim_backend.pixel.effects.registry import effect_from_dict

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

STATISTICS = 50
CHANCE = 0.3  # of each statistic in each of two sets, standard errors
MODEL = PixelModel(theta_on=0.3, theta_off=0.3, noise_rms=0.04, corner_hz=100.0, refractory_s=1e-3)


@dataclass
class Bent:
    """A truth whose first statistics go with the logarithms of thresholds and leak, along lines that are bent."""

    shown: Callable[[PixelModel], Floats]
    truth: Floats
    seed: int = 0

    def apart(self, model: PixelModel, truth: Any = None, late_us: int = 0) -> tuple[Floats, Floats]:
        """Return the truth less a model, from two sets of sensors."""
        of = self.truth if truth is None else self.shown(truth)
        left = of - self.shown(model) - 0.5 * late_us
        rng = np.random.default_rng(self.seed)
        return left + CHANCE * rng.standard_normal(STATISTICS), left + CHANCE * rng.standard_normal(STATISTICS)

    def changes(
        self, model: PixelModel, others: Sequence[PixelModel], steps: Sequence[float]
    ) -> tuple[Floats, Floats]:  # fmt: skip
        """Return what changes from a model to each of the others, by unit of its step."""
        here = self.shown(model)
        columns = np.stack([(self.shown(m) - here) / s for m, s in zip(others, steps, strict=True)], axis=1)
        return columns, columns

    def delayed(self, _: PixelModel) -> tuple[Floats, Floats]:
        """Return what changes when all events come 10 us later."""
        return np.full((STATISTICS, 1), 5.0), np.full((STATISTICS, 1), 5.0)


def bent(model: PixelModel) -> Floats:
    """Return statistics of which the first two turn while the ON threshold grows; the third goes with the leak."""
    leak = model.effect("leak")
    angle, shown = 2.0 * (model.theta_on - 0.3), np.zeros(STATISTICS)
    shown[:2] = 100.0 * model.theta_on * np.cos(angle), 100.0 * model.theta_on * np.sin(angle)
    shown[2] = 200.0 * (cast("Any", leak).rate_per_s if leak else 0.0) ** 0.5
    return shown


def with_leak(rate: float, theta_on: float = 0.3) -> PixelModel:
    return replace(MODEL, theta_on=theta_on) + effect_from_dict("leak", {"rate_per_s": rate})


@pytest.mark.parametrize("truth", [with_leak(0.2, 0.9), with_leak(0.02, 0.2), with_leak(0.4, 0.5)])
def test_what_other_numbers_make_the_same_leaves_chance(truth: PixelModel) -> None:
    """Straight lines alone leave hundreds."""
    left = least_left(cast("Any", Bent(bent, bent(truth))), Place.of(with_leak(0.1))).left
    assert abs(left) < 3.0 * CHANCE**2 * np.sqrt(STATISTICS) + 0.05 * STATISTICS * CHANCE**2


def test_a_later_clock_is_followed() -> None:
    truth = Bent(bent, bent(with_leak(0.1)) + 3.0)  # 6 us
    left = least_left(cast("Any", truth), Place.of(with_leak(0.1))).left
    assert left == pytest.approx(0.6**2, abs=3.0 * CHANCE**2 * np.sqrt(STATISTICS) + 0.5)


def test_what_goes_with_a_much_later_clock_is_left_to_what_is_known_of_it() -> None:
    """One step along a straight line does not lead as far, and another model stands for the truth as well."""

    def late(model: PixelModel) -> Floats:
        return bent(model) + (65.0 if model.effect("leak") else 0.0)  # 130 us

    rest = with_leak(0.1).without("leak")
    truth = cast("Any", Bent(late, late(with_leak(1e-9))))
    changes, prior = changes_by(truth, rest)
    for other in (None, with_leak(1e-9)):
        least = left_along(truth, rest, other, truth.apart(rest, other), changes, prior)
        assert least.known == pytest.approx(13.0**2, rel=0.02)
        assert least.left == pytest.approx(13.0**2, abs=3.0 * least.doubt)
        assert least.place.late_us == pytest.approx(130, abs=1)


def test_what_no_number_makes_is_left() -> None:
    shown = bent(with_leak(0.2, 0.5))
    shown[7] = 12.0
    left = least_left(cast("Any", Bent(bent, shown)), Place.of(with_leak(0.1))).left
    assert left == pytest.approx(144.0, abs=3.0 * 2.0 * 12.0 * CHANCE)


def test_a_promise_that_is_not_kept_is_not_believed() -> None:
    """Where straight lines promise that nothing is left, and nothing becomes less that way, all of it is left."""

    def wayward(model: PixelModel) -> Floats:
        shown = np.zeros(STATISTICS)
        away = abs(np.log(model.theta_on / 0.3))
        shown[0] = min(20.0 * away, 1.5) if away < 0.1 else 1.5 - 100.0 * away
        return shown

    truth = np.zeros(STATISTICS)
    truth[0] = 40.0
    left = least_left(cast("Any", Bent(wayward, truth)), Place.of(replace(MODEL))).left
    assert left > 0.9 * (40.0 - 1.5) ** 2


def test_a_place_goes_with_its_numbers_and_not_beyond_their_bounds() -> None:
    apart = np.full(STATISTICS, -1e6)
    changes, prior = Bent(bent, apart).changes(MODEL, [replace(MODEL, theta_on=0.31)], [0.05]), np.zeros(7)
    columns = np.zeros((STATISTICS, 6))
    columns[:, 0] = changes[0][:, 0]
    place = Place.of(MODEL).follow((apart, apart), (columns, columns), prior[:6])
    assert 0.02 <= place.model.theta_on < MODEL.theta_on
    assert place.late_us == 0
