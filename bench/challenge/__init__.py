"""The blind bench: a simulated station whose pixel nobody is told, and what a diagnosis of it is worth.

:func:`~bench.challenge.folder.make_challenge` makes one, :func:`~bench.challenge.folder.read_truth` opens it, and
:func:`~bench.challenge.score.score` holds a diagnosis against it.
"""

from __future__ import annotations
