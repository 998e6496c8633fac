"""Emulated instruments: firmware that answers byte by byte, so that real drivers are what runs.

All share one simulated world. Faults are put in by name (:mod:`sim_backend.wire.faults`).
"""
