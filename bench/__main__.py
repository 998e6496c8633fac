"""``python -m bench`` is ``evs-bench``."""

from bench.cli import main

main()
