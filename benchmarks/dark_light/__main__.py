"""Run the study: ``python -m benchmarks.dark_light``."""

from __future__ import annotations

import sys

from benchmarks.dark_light.study import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
