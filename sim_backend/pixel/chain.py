"""The measurement chain of each pixel as plain numbers: what effects alter and engines read."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sim_backend.pixel.philox import normals

if TYPE_CHECKING:
    import numpy.typing as npt

    from protocols.points import Roi
    from sim_backend.pixel.model import PixelModel

__all__ = ["LOWEST_CURRENT_FA", "LOWEST_THRESHOLD", "Chain", "PixelDraws", "build_chain", "pixel_ids"]

#: The logarithm is taken of no less than this photocurrent, fA.
LOWEST_CURRENT_FA: Final = 1e-4
#: A comparator cannot be set lower than this, ln units.
LOWEST_THRESHOLD: Final = 0.01


@dataclass(frozen=True, slots=True)
class Chain:
    """From light to events, for each of n pixels, without saying which effects made it so.

    The log photocurrent is ``u = ln(max(gain (E + stray) + dark, 1e-4 fA))``. White noise is added, a first-order
    low-pass of corner `corner_hz` follows; `noise_rms` is the stationary rms behind it. ON when the output is
    `theta_on` or more above the memorised level, OFF when it is `theta_off` or more below. Then the pixel is blind
    for `refractory_s`, memorises its output and goes on.
    """

    x: npt.NDArray[np.uint16]  #: (n,) column on the sensor
    y: npt.NDArray[np.uint16]  #: (n,) row on the sensor
    gain_fa_per_lux: npt.NDArray[np.float64]  #: (n,) photocurrent per illuminance
    dark_fa: npt.NDArray[np.float64]  #: (n,) current without light, fA
    theta_on: npt.NDArray[np.float64]  #: (n,) ln units
    theta_off: npt.NDArray[np.float64]  #: (n,) ln units
    refractory_s: npt.NDArray[np.float64]  #: (n,) s
    noise_rms: float  #: ln units, at the output of the low-pass
    corner_hz: float  #: Hz, of the low-pass
    stray_lux: float = 0.0  #: light on the chip that does not come from the source, lux
    rise_tau_s: float = 0.0  #: time constant of the source's edges, s

    @property
    def pixels(self) -> int:
        """Number of pixels."""
        return len(self.x)


def pixel_ids(x: npt.NDArray[np.uint16], y: npt.NDArray[np.uint16]) -> npt.NDArray[np.uint32]:
    """Return the number of each pixel on the sensor, the address of its random numbers."""
    return (y.astype(np.uint32) << np.uint32(16)) | x


class PixelDraws:
    """Frozen differences between pixels: the same pixel of the same sensor has the same numbers in every window.

    Parameters
    ----------
    x, y
        (n,) columns and rows on the sensor.
    sensor_seed
        Stands for the individual sensor.
    """

    def __init__(self, x: npt.NDArray[np.uint16], y: npt.NDArray[np.uint16], sensor_seed: int) -> None:
        self._index = pixel_ids(x, y)
        self._seed = sensor_seed

    def normal(self, purpose: str) -> npt.NDArray[np.float64]:
        """Return a standard normal number for each pixel; each `purpose` has its own."""
        return normals(self._seed, self._index, zlib.crc32(purpose.encode()))


def build_chain(model: PixelModel, roi: Roi, sensor_seed: int) -> Chain:
    """Return the chain of the pixels of a window, row by row, with all effects of the model in place.

    Parameters
    ----------
    model
        Base pixel and effects.
    roi
        Window in sensor coordinates, below 65 536 each.
    sensor_seed
        Stands for the individual sensor: fixes what differs from pixel to pixel.
    """
    rows, columns = np.mgrid[roi.y : roi.y + roi.height, roi.x : roi.x + roi.width]
    x, y = columns.ravel().astype(np.uint16), rows.ravel().astype(np.uint16)
    n = len(x)
    chain = Chain(
        x=x,
        y=y,
        gain_fa_per_lux=np.full(n, model.photoconversion.gain_fa_per_lux),
        dark_fa=np.zeros(n),
        theta_on=np.full(n, model.theta_on),
        theta_off=np.full(n, model.theta_off),
        refractory_s=np.full(n, model.refractory_s),
        noise_rms=model.noise_rms,
        corner_hz=model.corner_hz,
    )
    draws = PixelDraws(x, y, sensor_seed)
    for effect in model.effects:
        chain = effect.apply(chain, draws)
    return chain
