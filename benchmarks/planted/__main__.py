"""Run the study: ``python -m benchmarks.planted``."""

from __future__ import annotations

import sys

from benchmarks.planted.study import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
