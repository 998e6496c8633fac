"""The measurement chain of each pixel as plain numbers: what effects alter and engines read."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from sim_backend.pixel.hooks import Hooks, with_hooks
from sim_backend.pixel.philox import normals, uniforms

if TYPE_CHECKING:
    import numpy.typing as npt

    from protocols.points import Roi
    from sim_backend.pixel.model import PixelModel

__all__ = [
    "ELEMENTARY_CHARGE_FA_S",
    "LOWEST_CURRENT_FA",
    "LOWEST_THRESHOLD",
    "Chain",
    "PixelDraws",
    "build_chain",
    "pixel_ids",
]

ELEMENTARY_CHARGE_FA_S: Final = 1.602176634e-4

#: The logarithm is taken of no less than this photocurrent, fA.
LOWEST_CURRENT_FA: Final = 1e-4
#: A comparator cannot be set lower than this, ln units.
LOWEST_THRESHOLD: Final = 0.01


@dataclass(frozen=True, slots=True)
class Chain:
    """From light to events, for each of n pixels, without saying which effects made it so.

    Each field has a value at which it does nothing; those with a default have it as default. In the order in which a
    signal passes them:

    - Light: the commanded levels with their log contrast to the first of the recording times `contrast_gain`, behind
      the rise time, times ``max(1 + drift_per_s t, 0)``, times ``1 + flicker_depth sin(2 pi flicker_hz t + phase)``,
      times ``10^-nd_error_od`` while a filter is in, plus `stray_lux`: that is E.
    - Photocurrent: ``I = max(gain E + dark, 1e-4 fA)``, ``u = ln I`` plus white noise of variance
      ``shot_factor q / (I dt)`` in a sample.
    - Photoreceptor: first-order low-pass, corner ``min(receptor_hz_per_fa I, receptor_max_hz)``; none where both are
      infinite.
    - Source follower: white noise, then a first-order low-pass of corner `corner_hz`; `noise_rms` is the stationary
      rms that this noise has behind it. Then slow noise is added, `slow_rms` and `slow_tau_s`.
    - Change detector: first-order high-pass of corner `high_pass_hz`; ``D = V - V_ref + integral of (leak_per_s +
      leak_per_s_per_lux E) dt`` since the reset; ``V_ref = V + injection_ln + reset_rms z`` at a reset.
    - Comparators: ON when ``D >= theta_on``, OFF when ``D <= -theta_off``, answered `comparator_delay_s` later.
    - Refractory: then the pixel is blind for `refractory_s`, is reset, and goes on.
    - Readout: Poisson events of hot pixels; copies into neighbours; one server with a queue; jitter of the stamps;
      sorting; trail filter; rate limit.

    Functions of effects act at the end of their stage: `hooks`.
    """

    x: npt.NDArray[np.uint16]  #: (n,) column on the sensor
    y: npt.NDArray[np.uint16]  #: (n,) row on the sensor
    gain_fa_per_lux: npt.NDArray[np.float64]  #: (n,) photocurrent per illuminance
    dark_fa: npt.NDArray[np.float64]  #: (n,) current without light, fA
    theta_on: npt.NDArray[np.float64]  #: (n,) ln units
    theta_off: npt.NDArray[np.float64]  #: (n,) ln units
    refractory_s: npt.NDArray[np.float64]  #: (n,) s
    leak_per_s: npt.NDArray[np.float64]  #: (n,) ln units per s, drift of D towards ON
    hot_hz: npt.NDArray[np.float64]  #: (n,) ON events of their own that a pixel adds, Hz
    noise_rms: float  #: ln units, at the output of the source follower's low-pass
    corner_hz: float  #: Hz, of the source follower's low-pass
    contrast_gain: float = 1.0  #: true log contrast per commanded one
    rise_tau_s: float = 0.0  #: time constant of the source's edges, s
    drift_per_s: float = 0.0  #: relative change of the light, 1/s
    flicker_depth: float = 0.0  #: relative amplitude of the light's ripple
    flicker_hz: float = 0.0  #: frequency of the ripple, Hz
    flicker_phase: float | None = None  #: phase of the ripple at t = 0, rad; None: another in each recording
    flicker_settled_hz: float = math.inf  #: corner of a low-pass behind which pixels had settled to it at t = 0, Hz
    nd_error_od: float = 0.0  #: what a filter in the path attenuates more than nominally, OD
    stray_lux: float = 0.0  #: light on the chip that does not come from the source, lux
    shot_factor: float = 0.0  #: power of the shot noise, 1 = Poisson
    receptor_hz_per_fa: float = math.inf  #: corner of the photoreceptor per photocurrent, Hz/fA
    receptor_max_hz: float = math.inf  #: highest corner of the photoreceptor, Hz
    slow_rms: float = 0.0  #: ln units, rms of the slow noise
    slow_tau_s: float = 1.0  #: correlation time of the slow noise, s
    high_pass_hz: float = 0.0  #: corner of the high-pass, Hz; 0: none
    leak_per_s_per_lux: float = 0.0  #: ln units per s and lux, drift of D towards ON
    injection_ln: float = 0.0  #: ln units, offset of the memorised level
    reset_rms: float = 0.0  #: ln units, noise of the memorised level
    comparator_delay_s: float = 0.0  #: from the crossing to the event and the start of the dead time, s
    crosstalk: float = 0.0  #: probability that an event is copied into one of the four neighbours
    queue_eps: float = math.inf  #: events per second that the readout can serve
    queue_events: float = math.inf  #: most events in the readout's queue, the one being served among them
    jitter_s: float = 0.0  #: standard deviation of the time stamps, s
    trail_s: float = 0.0  #: time without an event after which a run of one polarity is over, s
    limit_eps: float = math.inf  #: events per second that pass the rate limit
    limit_period_s: float = 2e-4  #: period in which the rate limit counts, s
    hooks: Hooks = field(default_factory=Hooks)  #: what numbers cannot say

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
    even
        Numbers from 0 to 1 are spread evenly over the pixels: a share of them is as exact as their number lets it be,
        and by chance right on average. Of real sensors it is not; what one expects of them is told by fewer such.
    """

    def __init__(
        self, x: npt.NDArray[np.uint16], y: npt.NDArray[np.uint16], sensor_seed: int, *, even: bool = False
    ) -> None:  # fmt: skip
        self._index = pixel_ids(x, y)
        self._seed = sensor_seed
        self._even = even

    def normal(self, purpose: str) -> npt.NDArray[np.float64]:
        """Return a standard normal number for each pixel; each `purpose` has its own."""
        return normals(self._seed, self._index, zlib.crc32(purpose.encode()))

    def uniform(self, purpose: str) -> npt.NDArray[np.float64]:
        """Return a number from 0 to below 1 for each pixel; each `purpose` has its own."""
        found = uniforms(self._seed, self._index, zlib.crc32(purpose.encode()))
        if not self._even:
            return found
        first = uniforms(self._seed, np.zeros(1, np.uint32), zlib.crc32(f"{purpose}, the first".encode()))
        return np.asarray((np.argsort(np.argsort(found)) + first) / found.size)


def build_chain(model: PixelModel, roi: Roi, sensor_seed: int, *, even: bool = False) -> Chain:
    """Return the chain of the pixels of a window, row by row, with all effects of the model in place.

    Parameters
    ----------
    model
        Base pixel and effects.
    roi
        Window in sensor coordinates, below 65 536 each.
    sensor_seed
        Stands for the individual sensor: fixes what differs from pixel to pixel.
    even
        See :class:`PixelDraws`.
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
        leak_per_s=np.zeros(n),
        hot_hz=np.zeros(n),
        noise_rms=model.noise_rms,
        corner_hz=model.corner_hz,
    )
    draws = PixelDraws(x, y, sensor_seed, even=even)
    for effect in model.effects:
        chain = effect.apply(chain, draws)
        chain = replace(chain, hooks=with_hooks(chain.hooks, effect))
    return chain
