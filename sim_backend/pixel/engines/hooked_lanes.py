"""Groups of pixels on which functions of effects act."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from protocols.errors import InputError
from sim_backend.pixel.engines import hooked_kernels, reference_kernels
from sim_backend.pixel.engines.lanes import GeneralLanes, in_parts, to_lanes
from sim_backend.pixel.engines.user_kernels import address
from sim_backend.pixel.hooks import COMPILED, refused

if TYPE_CHECKING:
    import numpy.typing as npt

    from sim_backend.pixel.chain import Chain
    from sim_backend.pixel.engines.lanes import Grid, LightStretch

    Floats = npt.NDArray[np.float64]

__all__ = ["HookedLanes"]

#: What each hook must give, by its number.
_EXPECTED: Final = (
    "a finite number, ln units",
    f"more than {hooked_kernels.LOWEST_CORNER_HZ:g} Hz",
    "0 or more, ln units",
    "a finite number, ln units per s",
    "more than 0, ln units",
    f"0 to {hooked_kernels.LONGEST_DEAD_S:g} s",
)


class HookedLanes(GeneralLanes):
    """The general pixel, with the compiled functions of its effects."""

    def __init__(self, grid: Grid, chain: Chain, pixels: slice, start_lux: float, key: tuple[Any, Any]) -> None:
        self._chain = chain
        self._grid = grid
        self._start_lux = start_lux
        self._trouble = np.zeros(3)
        self._resets = np.zeros((3, reference_kernels.LANES))
        super().__init__(grid, chain, pixels, start_lux, key)
        self.kept = np.concatenate([self.kept, np.zeros(reference_kernels.LANES)])

    def at_light(self, current: Floats) -> tuple[Floats, Floats, Floats | float]:
        """Return for a photocurrent of each lane u, ratio of the photoreceptor, rms of the noise in a sample."""
        self._pixel = self._described()
        u, ratio, sigma = hooked_kernels.start_light(current, np.log(current), self._pixel, self._trouble)
        self._stop_at_trouble()
        return u, ratio, sigma

    def memorise(self, value: Floats) -> None:
        """Reset all lanes at t = 0."""
        current = self.current_fa(self._start_lux)
        hooked_kernels.start_levels(
            value, current, self._pixel, self._resets, self.levels, self.wake, self._trouble
        )  # fmt: skip
        self._stop_at_trouble()

    def advance(self, light: LightStretch) -> npt.NDArray[np.int64]:
        """Go through a stretch; return the events, (m, 3): sample, lane, polarity."""

        def run(n: int, skip: int, room: npt.NDArray[np.int64]) -> tuple[int, int]:
            found: tuple[int, int] = hooked_kernels.run_group(
                n, light.stop, light.lux[skip:], light.steady[skip // reference_kernels.BLOCK :], light.leaked[skip:],
                self._pixel, self.kept, self._resets, self.levels, self.wake, room, self._trouble,
            )  # fmt: skip
            self._stop_at_trouble()
            return found

        return in_parts(light, run)

    def _described(self) -> hooked_kernels.Pixel:
        """Return all that is no state, as the kernel wants it."""
        chain, lanes = self._chain, reference_kernels.LANES
        hooks = [address(name, getattr(chain.hooks, name)) for name in COMPILED]
        of_pixels = (
            chain.gain_fa_per_lux, chain.dark_fa, chain.theta_on, chain.theta_off, chain.refractory_s,
            chain.leak_per_s,
        )  # fmt: skip
        return hooked_kernels.Pixel(
            c=self.c,
            m=self._numbers(),
            f=hooked_kernels.Functions(*(function for function, _ in hooks)),
            p=hooked_kernels.Functions(*(parameters for _, parameters in hooks)),
            fixed=np.stack([to_lanes(values[self.pixels], lanes, 1.0) for values in of_pixels]),
            pixel=self.pixel,
            key=self.key,
        )

    def _numbers(self) -> hooked_kernels.Numbers:
        chain = self._chain
        return hooked_kernels.Numbers(
            used=self.pixels.stop - self.pixels.start,
            watch=len(chain.hooks.thresholds) > 0,
            noise_rms=float(chain.noise_rms),
            noise_root=math.sqrt(1.0 - self.c.rho**2),
            receptor_hz_per_fa=float(chain.receptor_hz_per_fa),
            receptor_max_hz=float(chain.receptor_max_hz),
            ratio_per_hz=float(self._grid.ratio(1.0)),
            delay_s=float(chain.comparator_delay_s),
            injection_ln=float(chain.injection_ln),
        )

    def _stop_at_trouble(self) -> None:
        """Raise :class:`InputError` if a function gave what cannot be used."""
        number, value, current = self._trouble
        if number == 0.0:
            return
        if number == hooked_kernels.EULER_TOO_LONG:
            raise InputError(
                f"reference engine: dt {self._grid.dt_s:g} s is not below the time constant of the photoreceptor, "
                f"{value:g} Hz at {current:g} fA; use a shorter dt or the exact step"
            )
        index = int(number) - 1
        hook = getattr(self._chain.hooks, COMPILED[index])[-1]
        raise refused(hook, f"{value:g} at a photocurrent of {current:g} fA", _EXPECTED[index])
