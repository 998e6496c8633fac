"""Figures, tables and the HTML report."""

from __future__ import annotations

from bench.report.trace import ModelTrace
from bench.report.write import write_report

__all__ = ["ModelTrace", "write_report"]
