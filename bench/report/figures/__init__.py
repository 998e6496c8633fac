"""The figures of the report: each module has `prepare` (numbers) and `draw` (a figure of those numbers)."""
