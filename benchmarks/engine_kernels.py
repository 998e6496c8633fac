"""The loop that one writes first: a pixel after the other, with the library's normal numbers; for comparison."""

from __future__ import annotations

import numpy as np

from drivers.jit import njit


@njit(nogil=True)
def plain_loop(pixels, samples, u, rho, sigma, theta, dead):  # type: ignore[no-untyped-def]
    """Return the number of events of `pixels` pixels in `samples` samples under constant light."""
    events = 0
    for _ in range(pixels):
        v = u
        reference = u
        blind = 0
        for _ in range(samples):
            v = rho * v + (1.0 - rho) * u + sigma * np.random.normal()
            if blind > 0:
                blind -= 1
                if blind == 0:
                    reference = v
            elif abs(v - reference) >= theta:
                events += 1
                blind = dead
    return events
