"""What the biases of a sensor do, measured: from a run to the bias map of its station."""

from __future__ import annotations

from bench.bias_calibration.calibrate import BiasCalibration, calibrate_biases

__all__ = ["BiasCalibration", "calibrate_biases"]
