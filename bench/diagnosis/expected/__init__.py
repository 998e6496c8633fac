"""What a model lets expect of a run: its numbers, the simulation of every point, and what is measured beside it."""
