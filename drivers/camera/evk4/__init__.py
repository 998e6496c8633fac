"""The Prophesee EVK4: a Sony IMX636 sensor behind a USB controller that speaks Treuzell.

Registers, sequences, biases and formats are facts of OpenEB 5.1.1 (prophesee-ai/openeb, Apache-2.0).
"""
