"""Simulated instruments: the ports of one :class:`~sim_backend.world.OpticalBench`, behind the drivers' interfaces.

Each device talks to the world in its private hooks alone (`_connect`, `_set_level`, `_play`, `_select`, ...), as a
real driver talks to its transport there: this is where a device can be made to fail.
"""
