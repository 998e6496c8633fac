"""`evs-bench diagnose`: what goes to stdout, to stderr, and into files. The diagnosis itself is a stub here."""

from __future__ import annotations

PROTOCOL = """\
format: evs-bench-protocol/1
title: dark
roi: {x: 10, y: 20, width: 2, height: 2}
measurements:
  - name: dark
    stimulus: {kind: constant, duration_s: 0.1}
    sweep: {illuminance_lux: [100]}
"""
