"""Compare the events of both engines at all settings, 1e5 pulses each (constant light: as many pixel-seconds).

Run with ``make verify`` or ``python benchmarks/equal_statistics.py``; it ends with 1 if the engines differ, that is
if the smallest p-value of all statistics of all settings, corrected for their number, is below 0.01. Names of
settings may be given, and another number of pulses::

    python benchmarks/equal_statistics.py --pulses 20000 "200 Hz, 10 ms" "two poles, low light"

With ``--power`` the fast engine is compared with itself made wrong instead: thresholds 1 % too high, a dead time 10 %
too long, an effect left out. That says which errors the comparison would have found.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import astuple, fields, replace
from typing import TYPE_CHECKING

from protocols.points import Roi
from sim_backend.pixel import FastEngine, ReferenceEngine
from sim_backend.pixel.engines.compare import Figures, figures, p_values
from sim_backend.pixel.engines.settings import SETTINGS, setting
from sim_backend.pixel.engines.sign_flips import holm

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sim_backend.pixel import PixelModel
    from sim_backend.pixel.engines.settings import Setting

LEVEL = 0.01
PULSES = 100_000
PULSE_PERIOD_S = 0.2
ROI = Roi(0, 0, 32, 32)
WIDTH = max(len(s.name) for s in SETTINGS)


def compare(one: Setting, pulse_count: int, seed: int) -> dict[str, float]:
    """Take a recording with each engine, print a row, and return the p-values."""
    start = time.perf_counter()
    pulses = one.pulses(ROI, pulse_count * PULSE_PERIOD_S)
    pair = (one.events(ReferenceEngine(), pulses, seed), one.events(FastEngine(), pulses, seed + 1))
    pixels = one.chain(ROI).pixels
    both = zip(*(astuple(figures(events, pulses, pixels)) for events in pair), strict=True)
    found = p_values(pair[0], pair[1], pulses)
    least = min(found, key=lambda name: found[name])
    texts = "  ".join(f"{a:8.4f} {b:8.4f}" for a, b in both)
    end = f"{found[least]:8.2g} {least} ({time.perf_counter() - start:.0f} s)"
    print(f"{one.name:{WIDTH}}  {pixels * pulses.periods:8d}  {texts}  {end}", flush=True)
    return found


def verify(chosen: Sequence[Setting], pulse_count: int, seed: int) -> int:
    """Compare and print; return 1 if the engines differ."""
    heads = "  ".join(f"{f.name:>17}" for f in fields(Figures))
    print(f"{'reference, fast':{WIDTH}}   periods  {heads}  smallest p")
    found = {}
    for one in chosen:
        found.update({f"{one.name}: {name}": p for name, p in compare(one, pulse_count, seed).items()})
    corrected = holm(found)
    print(f"{len(chosen)} settings, {len(found)} tests; corrected for their number (Holm), the smallest are")
    for name in sorted(found, key=lambda n: found[n])[:5]:
        print(f"  {corrected[name]:8.2g}  {name} (by itself {found[name]:.2g})")
    differ = min(corrected.values()) < LEVEL
    print(f"the engines {'DIFFER' if differ else 'do not differ'} at the level of {LEVEL:g}")
    return int(differ)


def errors(model: PixelModel) -> dict[str, PixelModel]:
    """Return models that are a little wrong."""
    wrong = {
        "thresholds + 1 %": replace(model, theta_on=1.01 * model.theta_on, theta_off=1.01 * model.theta_off),
        "dead time + 10 %": replace(model, refractory_s=1.1 * model.refractory_s),
    }
    return wrong | {f"no {e.id}": model.without(e.id) for e in model.effects}


def show_power(chosen: Sequence[Setting], pulse_count: int, seed: int) -> int:
    """Print how the fast engine differs from a wrong one; return 0."""
    tests = len(SETTINGS) * 12
    print(f"{'setting':{WIDTH}}  {'error':30}  smallest p, corrected for {tests} tests")
    for one in chosen:
        pulses = one.pulses(ROI, pulse_count * PULSE_PERIOD_S)
        right = one.events(FastEngine(), pulses, seed)
        for error, model in errors(one.model).items():
            found = p_values(right, replace(one, model=model).events(FastEngine(), pulses, seed + 1), pulses)
            least = min(found, key=lambda name: found[name])
            corrected = min(1.0, tests * found[least])
            verdict = least if corrected < LEVEL else "NOT FOUND"
            print(f"{one.name:{WIDTH}}  {error:30}  {corrected:8.2g}  {verdict}", flush=True)
    return 0


def main(arguments: list[str]) -> int:
    """Compare and print; return 1 if the engines differ."""
    parser = argparse.ArgumentParser(description="compare both engines")
    parser.add_argument("--pulses", type=int, default=PULSES, help="at each setting")
    parser.add_argument("--seed", type=int, default=1, help="another seed, other events")
    parser.add_argument("--power", action="store_true", help="compare the fast engine with itself made wrong")
    parser.add_argument("names", nargs="*", help="settings; all if none is named")
    asked = parser.parse_args(arguments)
    chosen = [setting(name) for name in asked.names] or SETTINGS
    return (show_power if asked.power else verify)(chosen, asked.pulses, asked.seed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
